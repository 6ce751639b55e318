/* Which of two estimators is believed, and what is used of their gain and delay of the power.
 *
 * The delay is linearised, and that reaches no further than about a second: a response that is later still passes for a
 * weak gain, and a controller that believes this swings. So while the power tells anything, a rival runs beside the
 * estimator, with the same estimates but the other range of the delay, and the one that makes the temperatures more likely
 * goes on. If neither fits, the gain is not taken for less than the model's.
 *
 * Of an estimate only what is certain is used: the value nearest to the model's that lies within some standard deviations. Of
 * the gain, the root: a faster or slower probe, or a softer copper, passes for a gain, too, and the loop bears what is left. */
#include <math.h>

#include "internal.h"

#define N FSW_STATES

enum { TEMPERATURE = 2 };

static int is_adapting(const fsw_estimator_tuning *t) { return t->thermal_gain_walk + t->delay_walk_s > 0.0; }

void fsw_adaptation_start(fsw_nmpc *c) {
  fsw_adaptation *a = &c->adaptation;
  a->rival.started = a->is_beaten = a->is_refuted = 0;
  a->evidence = a->delay_s = a->heat_kw = 0.0;
  a->gain = a->misfit = 1.0;
}

/* Square of the last innovation of the temperature in its deviation, that of a jump at most. */
static double square_of(const fsw_estimator *e, const fsw_estimator_tuning *t) {
  const double square = e->innovation[TEMPERATURE] * e->innovation[TEMPERATURE] / e->expected[TEMPERATURE];
  const double most = t->jump_sigmas * t->jump_sigmas;
  return most > 0.0 && square > most ? most : square;
}

/* By how much the last temperature is more likely with one estimator than with another: logarithm of the ratio. */
static double more_likely(const fsw_estimator *e, const fsw_estimator *other, const fsw_estimator_tuning *t) {
  const double own = e->expected[TEMPERATURE], its = other->expected[TEMPERATURE];
  if (!(own > 0.0 && its > 0.0)) return 0.0;
  const double u = (its - own) / (its + own); /* log(its / own) / 2, as a series */
  return 0.5 * (square_of(other, t) - square_of(e, t)) + u + u * u * u / 3.0;
}

/* The rival begins with the estimates of the estimator, but a delay in the middle of the other range. */
static void challenge(fsw_nmpc *c) {
  fsw_estimator *rival = &c->adaptation.rival;
  const double half_s = fsw_delay_span_s(&c->model, &c->tuning.estimator);
  *rival = c->estimator;
  rival->is_late = !rival->is_late;
  rival->x[FSW_DELAY] = rival->is_late ? 2.0 * half_s : 0.0;
  for (int i = 0; i < N; i++) rival->p[FSW_DELAY][i] = rival->p[i][FSW_DELAY] = 0.0;
  const double share = c->tuning.adaptation.rival_share;
  rival->p[FSW_DELAY][FSW_DELAY] = share * share * half_s * half_s;
  c->adaptation.evidence = c->adaptation.is_beaten ? -c->tuning.adaptation.counter_evidence_max : 0.0;
}

/* Byte by byte: an estimator is too large for the stack. */
static void exchange(fsw_estimator *one, fsw_estimator *other) {
  unsigned char *a = (unsigned char *)one, *b = (unsigned char *)other;
  for (unsigned i = 0; i < sizeof *one; i++) {
    const unsigned char byte = a[i];
    a[i] = b[i];
    b[i] = byte;
  }
}

/* Ticks by which a response may be later than estimated: no later than its range once the later one is beaten. */
static int later_ticks(const fsw_nmpc *c) {
  if (c->estimator.is_late || !c->adaptation.is_beaten) return FSW_SLOWER;
  return (int)((fsw_delay_span_s(&c->model, &c->tuning.estimator) - c->estimator.x[FSW_DELAY]) / FSW_TICK_S + 0.5);
}

/* What the last temperature tells in favour of the rival. Once the rival's range has lost, that counts for less: divided by how
 * badly the estimator fits, as innovations of one sign are not independent; and for a later response not at all while none
 * would explain them, as they are heat. */
static double evidence_of(const fsw_nmpc *c) {
  const fsw_adaptation *a = &c->adaptation;
  const double more = more_likely(&a->rival, &c->estimator, &c->tuning.estimator);
  if (!a->is_beaten) return more;
  if (!c->estimator.is_late && c->estimator.is_unexplained) return 0.0;
  return more / (a->misfit > 1.0 ? a->misfit : 1.0);
}

static void compete(fsw_nmpc *c, const fsw_nmpc_input *in) {
  fsw_adaptation *a = &c->adaptation;
  const fsw_adaptation_tuning *t = &c->tuning.adaptation;
  fsw_estimator *e = &c->estimator;
  e->later_ticks = later_ticks(c);
  a->rival.later_ticks = FSW_SLOWER;
  if (!e->heated_ticks || !(c->tuning.estimator.delay_walk_s > 0.0)) a->rival.started = 0;
  else if (!a->rival.started) {
    if (e->is_telling) challenge(c);
  } else if (fsw_estimator_step(&a->rival, &c->model, &c->tuning.estimator, in)) {
    a->evidence += evidence_of(c);
    if (a->evidence < -t->counter_evidence_max) {
      a->evidence = -t->counter_evidence_max;
      a->is_beaten = 1;
    }
    if (a->evidence > t->evidence_max) {
      exchange(e, &a->rival);
      a->evidence = 0.0;
      a->is_beaten = 0;
    }
  }
}

/* Whether the temperature contradicts any gain and delay within both ranges; until the power has come to rest. */
static void judge_fit(fsw_nmpc *c) {
  fsw_adaptation *a = &c->adaptation;
  const fsw_adaptation_tuning *t = &c->tuning.adaptation;
  const fsw_estimator *e = &c->estimator;
  if (!e->heated_ticks || !is_adapting(&c->tuning.estimator)) {
    a->misfit = 1.0;
    a->is_refuted = 0;
    return;
  }
  if (e->expected[TEMPERATURE] > 0.0) a->misfit += (1.0 - t->misfit_keep) * (square_of(e, &c->tuning.estimator) - a->misfit);
  if (a->misfit > t->misfit_max) a->is_refuted = 1;
}

int fsw_doubts_of(const fsw_nmpc *c) {
  return (c->estimator.is_doubtful ? FSW_DOUBT_LATE : 0) | (c->adaptation.is_refuted ? FSW_DOUBT_MISFIT : 0);
}

/* The value nearest to the model's that is within `certain_sigmas` standard deviations of the estimate. */
static double certain(const fsw_nmpc *c, int state, double of_model) {
  const fsw_estimator *e = &c->estimator;
  const double deviation = c->tuning.adaptation.certain_sigmas * sqrt(e->p[state][state]), x = e->x[state];
  return fsw_clip(of_model, x - deviation, x + deviation);
}

/* The square root of what is certain of the gain. Where the response is late or fits no gain and delay, the larger gain is the
 * cautious one: all of it if it is above the model's. */
static double gain_in_use(const fsw_nmpc *c) {
  const double gain = certain(c, FSW_THERMAL_GAIN, 1.0);
  if (gain > 1.0) return c->estimator.is_late || c->adaptation.is_refuted ? gain : sqrt(gain);
  return c->adaptation.is_refuted ? 1.0 : sqrt(gain);
}

/* The heat of a prediction with another gain than the estimator's: the power of the last 20 s heats alike with both,
 * so that a process at rest does not stay off its set-point. */
static double heat_in_use(fsw_nmpc *c) {
  const fsw_estimator *e = &c->estimator;
  fsw_adaptation *a = &c->adaptation;
  a->power_kw += FSW_TICK_S / c->tuning.adaptation.power_memory_s * (e->power[0] - a->power_kw);
  return e->x[FSW_HEAT] + (e->x[FSW_THERMAL_GAIN] / a->gain - 1.0) * (a->power_kw + e->x[FSW_HEAT]);
}

/* One tick of the estimator, of its rival, and of what is used of them. Returns whether the estimate is sound. */
int fsw_adapt(fsw_nmpc *c, const fsw_nmpc_input *in) {
  fsw_adaptation *a = &c->adaptation;
  const fsw_adaptation_tuning *t = &c->tuning.adaptation;
  if (!fsw_estimator_step(&c->estimator, &c->model, &c->tuning.estimator, in)) return 0;
  compete(c, in);
  judge_fit(c);
  const double gain = gain_in_use(c), delay_s = certain(c, FSW_DELAY, 0.0);
  a->gain = fsw_clip(gain, a->gain - t->gain_step, a->gain + t->gain_step);
  a->delay_s = fsw_clip(delay_s, a->delay_s - t->delay_step_s, a->delay_s + t->delay_step_s);
  a->heat_kw = heat_in_use(c);
  return 1;
}
