/* Adaptation of gain and delay of the power: a choice between two estimators, and a cautious use
 * of the chosen one's estimates.
 *
 * The delay is linearised, which is valid for about a second: a later response would pass for a
 * weak gain, and a controller that trusts it oscillates. So while the power excites the
 * temperature, a rival with the same estimates but the other range of the delay runs beside the
 * estimator, and the one with the more likely innovations is kept (a sequential probability ratio
 * test, Wald 1945; two models of a multiple-model estimator, Bar-Shalom et al. 2001,
 * section 11.6). If neither fits, a gain below the model's is not used.
 *
 * Both estimates are used conservatively: the value nearest to the model's within some standard
 * deviations (certainty equivalence would react to noise). Of the gain the square root is used,
 * because a faster or slower probe, or softer copper, also looks like a gain; the loop tolerates
 * the remaining error. */
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

/* Squared last innovation of the temperature over its variance, limited to that of a jump. */
static double square_of(const fsw_estimator *e, const fsw_estimator_tuning *t) {
  const double square = e->innovation[TEMPERATURE] * e->innovation[TEMPERATURE] / e->expected[TEMPERATURE];
  const double most = t->jump_sigmas * t->jump_sigmas;
  return most > 0.0 && square > most ? most : square;
}

/* Log-likelihood ratio of the last temperature between two estimators (Gaussian innovations). */
static double more_likely(const fsw_estimator *e, const fsw_estimator *other, const fsw_estimator_tuning *t) {
  const double own = e->expected[TEMPERATURE], its = other->expected[TEMPERATURE];
  if (!(own > 0.0 && its > 0.0)) return 0.0;
  const double u = (its - own) / (its + own); /* log(its / own) / 2, as a series */
  return 0.5 * (square_of(other, t) - square_of(e, t)) + u + u * u * u / 3.0;
}

/* Start the rival with the estimator's states, but with the delay in the middle of the other range
 * and uncorrelated, since the correlations belong to the old delay. */
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

/* Byte by byte: an estimator is too large for the stack of a microcontroller. */
static void exchange(fsw_estimator *one, fsw_estimator *other) {
  unsigned char *a = (unsigned char *)one, *b = (unsigned char *)other;
  for (unsigned i = 0; i < sizeof *one; i++) {
    const unsigned char byte = a[i];
    a[i] = b[i];
    b[i] = byte;
  }
}

/* Ticks by which a response may be later than estimated; limited to the estimator's own range once
 * the later range has been rejected. */
static int later_ticks(const fsw_nmpc *c) {
  if (c->estimator.is_late || !c->adaptation.is_beaten) return FSW_SLOWER;
  return (int)((fsw_delay_span_s(&c->model, &c->tuning.estimator) - c->estimator.x[FSW_DELAY]) / FSW_TICK_S + 0.5);
}

/* Evidence of the last temperature for the rival. Once the rival's range has been rejected, it is
 * divided by the misfit, as innovations of one sign are not independent; and it is 0 for a later
 * response while no delay explains the innovations, because then they are heat. */
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

/* Whether the temperature contradicts every gain and delay of both ranges; reset once the power
 * has been at rest. The mean square of normalised innovations is 1 for a consistent filter (NIS
 * test). */
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

/* The value nearest to the model's within `certain_sigmas` standard deviations of the estimate. */
static double certain(const fsw_nmpc *c, int state, double of_model) {
  const fsw_estimator *e = &c->estimator;
  const double deviation = c->tuning.adaptation.certain_sigmas * sqrt(e->p[state][state]), x = e->x[state];
  return fsw_clip(of_model, x - deviation, x + deviation);
}

/* The gain in use: the root of its conservative value. If the response is late, or fits no gain
 * and delay, a larger gain is the cautious choice, so it is used in full. */
static double gain_in_use(const fsw_nmpc *c) {
  const double gain = certain(c, FSW_THERMAL_GAIN, 1.0);
  if (gain > 1.0) return c->estimator.is_late || c->adaptation.is_refuted ? gain : sqrt(gain);
  return c->adaptation.is_refuted ? 1.0 : sqrt(gain);
}

/* The heat disturbance that goes with the gain in use: chosen so that the mean power of the last
 * 20 s gives the same temperature as with the estimated gain. Otherwise a process at rest would
 * stay off its set-point. */
static double heat_in_use(fsw_nmpc *c) {
  const fsw_estimator *e = &c->estimator;
  fsw_adaptation *a = &c->adaptation;
  a->power_kw += FSW_TICK_S / c->tuning.adaptation.power_memory_s * (e->power[0] - a->power_kw);
  return e->x[FSW_HEAT] + (e->x[FSW_THERMAL_GAIN] / a->gain - 1.0) * (a->power_kw + e->x[FSW_HEAT]);
}

/* One tick of the estimator, its rival and the values in use. Returns whether the estimate is
 * sound.
 *
 * Gain and delay in use are rate-limited, so that the loop never sees a step of its own model. */
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
