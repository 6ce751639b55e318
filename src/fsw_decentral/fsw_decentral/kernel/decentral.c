/* Two loops side by side, discretised by backward Euler (Astrom and Hagglund, Advanced PID
 * Control). `follow` informs a loop about the fate of its last output: if limits have cut it, the
 * integrator is pulled back with the tracking time (back-calculation anti-windup); a command from
 * elsewhere sets it at once, so that the loop continues from that command without a bump.
 *
 * Finite but absurd samples may overflow to infinity or NaN anywhere; the step checks the results.
 * An applied command outside the bounds is clipped before anything uses it. */
#include <limits.h>
#include <math.h>
#include <stddef.h>

#include "fsw_decentral.h"

#define RAD_PER_S_PER_RPM (3.14159265358979323846 / 30.0)
#define KW_PER_NM_RPM (RAD_PER_S_PER_RPM * 1e-3)
/* commands closer than this (kN, rpm) are equal up to rounding of the unit conversion */
#define SAME 1e-6
/* distance at which a limit counts as touched */
#define TOUCHING 1e-9
#define LONGEST_STEP_S 1.0
/* A loop output beyond this (kN, rpm) comes from samples beyond all range: its integrator would
 * take minutes to return. */
#define MOST_WANTED 1e6
/* Lower bound of the torque: without contact there is no power, and the feedforward divides by it */
#define LEAST_TORQUE_NM 100.0

#ifndef FSW_DECENTRAL_ID
#define FSW_DECENTRAL_ID "unknown"
#endif
const char *fsw_decentral_id(void) { return FSW_DECENTRAL_ID; }

/* NaN passes through all of these. */
static int is_finite(double x) { return x - x == 0.0; }
static double at_least(double x, double low) { return low > x ? low : x; }
static double at_most(double x, double high) { return high < x ? high : x; }
static int is_within(double x, double most) { return x <= most && x >= -most; }
static double clipped(double x, double low, double high) { return at_most(at_least(x, low), high); }
static int is_elsewhere(double a, double b) { return a - b >= SAME || b - a >= SAME; }

/* Share of its input that a first-order filter takes over in one step (exact for a held input). */
static double share(double time_constant_s, double dt_s) {
  return time_constant_s <= 0.0 ? 1.0 : 1.0 - exp(-dt_s / time_constant_s);
}

/* ---- temperature to power, depth to force */

typedef struct {
  double gain, integral_time, derivative_time, filter, weight, reference_filter, tracking_time;
} loop_gains;

/* Change the gains bumplessly: the integrator compensates for the difference. */
static void loop_configure(fsw_decentral_loop *l, const loop_gains *g, double dt_s) {
  if (l->started) {
    const double before = l->gain * (l->weight * l->reference - l->measured);
    l->integrator += before - g->gain * (g->weight * l->reference - l->measured);
  }
  l->gain = g->gain;
  l->weight = g->weight;
  /* gains per tick: the time between ticks enters here only */
  l->integral = g->gain * dt_s / g->integral_time;
  l->derivative = g->gain * g->derivative_time / dt_s;
  l->filter = share(g->filter, dt_s);
  l->reference_filter = share(g->reference_filter, dt_s);
  l->tracking = at_most(dt_s / g->tracking_time, 1.0);
}

static void loop_clear(fsw_decentral_loop *l) {
  l->started = 0;
  l->first_stage = l->measured = l->reference = l->output = NAN;
  l->integrator = 0.0;
}

/* Start with the given output. */
static void loop_start(fsw_decentral_loop *l, double measured, double reference, double output) {
  l->measured = l->first_stage = measured;
  if (l->reference != l->reference) l->reference = reference;
  l->integrator = output - l->gain * (l->weight * l->reference - measured);
  l->output = output;
  l->started = 1;
}

/* Take the difference between the applied and the last output, due to limits or another source. */
static void loop_follow(fsw_decentral_loop *l, double excess, int elsewhere) {
  l->integrator += elsewhere ? excess : l->tracking * excess;
}

/* One tick of a PID in absolute form. The integrator gets the error of this tick before the output,
 * so a step of the set-point acts at once; the weight below 1 limits its proportional kick. */
static double loop_step(fsw_decentral_loop *l, double measured, double reference) {
  l->first_stage += l->filter * (measured - l->first_stage);
  const double move = l->filter * (l->first_stage - l->measured);
  l->measured += move;
  l->reference += l->reference_filter * (reference - l->reference);
  l->integrator += l->integral * (l->reference - l->measured);
  const double proportional = l->gain * (l->weight * l->reference - l->measured);
  l->output = proportional + l->integrator - l->derivative * move;
  return l->output;
}

/* ---- temperature one dead time ahead */

/* Advance the Smith predictor over the last tick's power; the first power counts as that of all
 * past time. The copper's lag is exact for a held power; the tool sees its mean over the tick. */
static void predictor_step(fsw_decentral_predictor *p, double power_kw, double dt_s) {
  if (p->delay_ticks <= 0.0) return;
  if (!p->started) {
    p->copper_kw = p->tool_kw = power_kw;
    for (int i = 0; i < FSW_DECENTRAL_HISTORY; i++) p->past_kw[i] = power_kw;
    p->newest = 0;
    p->started = 1;
  }
  int ticks = (int)(dt_s / FSW_DECENTRAL_TICK_S + 0.5);
  do {
    const double before_kw = p->copper_kw;
    p->copper_kw += p->copper * (power_kw - p->copper_kw);
    p->tool_kw += p->tool * (0.5 * (before_kw + p->copper_kw) - p->tool_kw);
    p->newest = (p->newest + 1) % FSW_DECENTRAL_HISTORY;
    p->past_kw[p->newest] = p->tool_kw;
  } while (--ticks > 0);
  const int whole = (int)p->delay_ticks, at = p->newest + FSW_DECENTRAL_HISTORY - whole;
  const double later_kw = p->past_kw[at % FSW_DECENTRAL_HISTORY], earlier_kw = p->past_kw[(at - 1) % FSW_DECENTRAL_HISTORY];
  p->correction_c = p->gain * (p->tool_kw - later_kw + (p->delay_ticks - whole) * (later_kw - earlier_kw));
}

static void predictor_clear(fsw_decentral_predictor *p) {
  p->started = 0;
  p->correction_c = 0.0;
}

/* Change the model; the prediction restarts at rest, the output of the loop `l` does not jump. */
static void predictor_configure(fsw_decentral_predictor *p, const fsw_decentral_tuning *t, fsw_decentral_loop *l) {
  const double delay_ticks = t->predictor_gain > 0.0 ? t->predictor_dead_time / FSW_DECENTRAL_TICK_S : 0.0;
  const double copper = share(t->predictor_copper_lag, FSW_DECENTRAL_TICK_S);
  const double tool = share(t->predictor_tool_lag, FSW_DECENTRAL_TICK_S);
  if (p->gain == t->predictor_gain && p->delay_ticks == delay_ticks && p->copper == copper && p->tool == tool) return;
  l->measured -= p->correction_c;
  l->first_stage -= p->correction_c;
  l->integrator -= l->started ? l->gain * p->correction_c : 0.0;
  predictor_clear(p);
  p->gain = t->predictor_gain;
  p->delay_ticks = delay_ticks;
  p->copper = copper;
  p->tool = tool;
}

/* ---- power to speed */

static void power_clear(fsw_decentral_power *p, double torque_nm) {
  p->started = 0;
  p->now_nm = p->fast_nm = p->slow_nm = torque_nm;
  p->caused_kn = p->seen_kn = NAN;
  p->output = NAN;
  p->integrator = p->gained = 0.0;
}

/* Take the next process torque; before the first step it is not filtered. */
static void power_measure(fsw_decentral_power *p, double torque_nm) {
  p->now_nm = torque_nm;
  if (!p->started) {
    p->fast_nm = p->slow_nm = torque_nm;
    return;
  }
  p->fast_nm += p->filter * (torque_nm - p->fast_nm);
  p->slow_nm += p->feedforward * (torque_nm - p->slow_nm);
}

/* Take the difference between the applied and the last speed, due to a bound, the move limit or
 * another source. At a bound the loop does not integrate further outwards (clamping). What the
 * move limit has cut decays slowly, so that the loop makes up for the energy that was missing
 * while the speed could not follow. */
static void power_follow(fsw_decentral_power *p, double excess_rpm, int bounded, int elsewhere) {
  if (elsewhere)
    p->integrator = 0.0;
  else if (!bounded)
    p->integrator += p->tracking * excess_rpm;
  else if (excess_rpm * p->gained < 0.0)
    p->integrator -= p->gained;
}

/* Process torque with the next force: feedforward of its effect before the filtered torque shows
 * it. */
static double expected_nm(fsw_decentral_power *p, double force_kn) {
  if (p->caused_kn != p->caused_kn) p->caused_kn = p->seen_kn = force_kn;
  p->seen_kn += p->feedforward * (p->caused_kn - p->seen_kn);
  p->caused_kn += p->decoupling * (force_kn - p->caused_kn);
  return at_least(p->slow_nm + p->decoupling_nm_per_kn * (p->caused_kn - p->seen_kn), LEAST_TORQUE_NM);
}

/* Speed for a power reference; `speed_rpm` is the present speed, `force_kn` the next force. */
static double power_step(fsw_decentral_power *p, double reference_kw, double speed_rpm, double force_kn) {
  p->started = 1;
  const double error_kw = reference_kw - p->fast_nm * speed_rpm * KW_PER_NM_RPM;
  p->gained = p->integral * error_kw;
  p->integrator += p->gained;
  p->output = reference_kw / (expected_nm(p, force_kn) * KW_PER_NM_RPM) + p->gain * error_kw + p->integrator;
  return p->output;
}

/* ---- the controller */

int fsw_decentral_is_usable(const fsw_decentral_tuning *t) {
  const double *numbers = (const double *)t; /* it consists of nothing else */
  const double positive[] = {t->depth_integral_time, t->temperature_integral_time, t->power_integral_time,
                             t->depth_tracking_time, t->temperature_tracking_time, t->power_tracking_time,
                             t->nominal_torque_nm};
  for (size_t k = 0; k < sizeof *t / sizeof *numbers; k++) {
    const double *x = &numbers[k];
    const int may_be_negative = (x >= &t->force_min_kn && x <= &t->speed_max_rpm) || (x >= t->friction && x < t->friction + 3);
    if (!is_finite(*x) || (*x < 0.0 && !may_be_negative)) return 0;
  }
  for (size_t k = 0; k < sizeof positive / sizeof *positive; k++)
    if (!(positive[k] > 0.0)) return 0;
  return t->predictor_dead_time <= FSW_DECENTRAL_LONGEST_DEAD_TIME_S && t->force_min_kn < t->force_max_kn &&
         t->speed_min_rpm < t->speed_max_rpm;
}

static void configure_loops(fsw_decentral *c) {
  const fsw_decentral_tuning *t = &c->tuning;
  const double dt_s = c->dt_s;
  const loop_gains depth = {t->depth_gain,   t->depth_integral_time,    t->depth_derivative_time, t->depth_filter,
                            t->depth_weight, t->depth_reference_filter, t->depth_tracking_time};
  const loop_gains temperature = {t->temperature_gain,   t->temperature_integral_time,    t->temperature_derivative_time,
                                  t->temperature_filter, t->temperature_weight,           t->temperature_reference_filter,
                                  t->temperature_tracking_time};
  predictor_configure(&c->predictor, t, &c->temperature);
  loop_configure(&c->depth, &depth, dt_s);
  loop_configure(&c->temperature, &temperature, dt_s);
  c->power.gain = t->power_gain;
  c->power.integral = t->power_gain * dt_s / t->power_integral_time;
  c->power.filter = share(t->power_filter, dt_s);
  c->power.feedforward = share(t->feedforward_filter, dt_s);
  c->power.decoupling_nm_per_kn = t->decoupling_torque;
  c->power.decoupling = share(t->decoupling_lag, dt_s);
  c->power.tracking = at_most(dt_s / t->power_tracking_time, 1.0);
}

static void start_loops(fsw_decentral *c) {
  loop_clear(&c->depth);
  loop_clear(&c->temperature);
  predictor_clear(&c->predictor);
  power_clear(&c->power, c->tuning.nominal_torque_nm);
  configure_loops(c);
}

int fsw_decentral_init(fsw_decentral *c, const fsw_decentral_tuning *tuning) {
  if (!fsw_decentral_is_usable(tuning)) return 1;
  c->tuning = *tuning;
  c->proposed_force_kn = 0.5 * tuning->force_min_kn + 0.5 * tuning->force_max_kn;
  c->proposed_speed_rpm = 0.5 * tuning->speed_min_rpm + 0.5 * tuning->speed_max_rpm;
  fsw_decentral_reset(c, c->proposed_force_kn, c->proposed_speed_rpm);
  return 0;
}

int fsw_decentral_configure(fsw_decentral *c, const fsw_decentral_tuning *tuning) {
  if (!fsw_decentral_is_usable(tuning)) return 1;
  c->tuning = *tuning;
  configure_loops(c);
  return 0;
}

void fsw_decentral_input_clear(fsw_decentral_input *in) {
  in->depth_mm = in->torque_nm = in->temperature_c = in->applied_force_kn = in->applied_speed_rpm = NAN;
  in->reference_depth_mm = in->reference_temperature_c = NAN;
  in->depth_valid = in->torque_valid = in->temperature_valid = 0;
  in->dt_s = FSW_DECENTRAL_TICK_S;
}

void fsw_decentral_reset(fsw_decentral *c, double force_kn, double speed_rpm) {
  c->dt_s = FSW_DECENTRAL_TICK_S;
  start_loops(c);
  if (is_finite(force_kn + speed_rpm)) {
    c->proposed_force_kn = clipped(force_kn, c->tuning.force_min_kn, c->tuning.force_max_kn);
    c->proposed_speed_rpm = clipped(speed_rpm, c->tuning.speed_min_rpm, c->tuning.speed_max_rpm);
  }
  c->speed_before_rpm = c->proposed_speed_rpm;
  c->reference_depth_mm = c->reference_temperature_c = NAN;
  c->blind_torque_s = c->blind_temperature_s = 0.0;
  c->bad_cycles = 0;
}

static double wanted_force_kn(fsw_decentral *c, const fsw_decentral_input *in, double applied_kn) {
  fsw_decentral_loop *l = &c->depth;
  if (!(in->depth_valid && is_finite(in->depth_mm) && is_finite(c->reference_depth_mm))) {
    l->started = 0; /* the force is held */
    return l->output = applied_kn;
  }
  if (!l->started) {
    loop_start(l, in->depth_mm, c->reference_depth_mm, applied_kn);
  } else {
    const int elsewhere = is_elsewhere(applied_kn, c->proposed_force_kn);
    const double excess = (elsewhere ? applied_kn : c->proposed_force_kn) - l->output;
    if (excess != 0.0) loop_follow(l, excess, elsewhere);
  }
  return loop_step(l, in->depth_mm, c->reference_depth_mm);
}

/* Inform power and temperature loop about the fate of the last speed. */
static void follow_speed(fsw_decentral *c, double applied_rpm) {
  fsw_decentral_loop *l = &c->temperature;
  const double proposed_rpm = c->proposed_speed_rpm, kw_per_rpm = c->power.slow_nm * KW_PER_NM_RPM;
  const int elsewhere = is_elsewhere(applied_rpm, proposed_rpm);
  const int bounded = !(c->tuning.speed_min_rpm < proposed_rpm && proposed_rpm < c->tuning.speed_max_rpm);
  const double excess_rpm = (elsewhere ? applied_rpm : proposed_rpm) - c->power.output;
  if (excess_rpm == 0.0) return;
  power_follow(&c->power, excess_rpm, bounded, elsewhere);
  if (elsewhere && !l->started) {
    l->output = applied_rpm * kw_per_rpm;
  } else if (elsewhere) {
    loop_follow(l, applied_rpm * kw_per_rpm - l->output, 1);
  } else if (bounded && l->started) {
    /* the power loop makes up for what the move limit delays; what a bound cuts is lost */
    const double excess_kw = proposed_rpm * kw_per_rpm - l->output;
    if (excess_kw * excess_rpm > 0.0) loop_follow(l, excess_kw, 0);
  }
}

/* Process torque: motor torque less friction (23) and less the torque that accelerates the
 * spindle. */
static void measure_torque(fsw_decentral *c, const fsw_decentral_input *in, double applied_rpm) {
  const double *friction = c->tuning.friction;
  const double acceleration_rpm_per_s = (applied_rpm - c->speed_before_rpm) / c->dt_s;
  c->speed_before_rpm = applied_rpm;
  if (!(in->torque_valid && is_finite(in->torque_nm))) {
    c->blind_torque_s += c->dt_s;
    return;
  }
  c->blind_torque_s = 0.0;
  const double friction_nm = friction[0] + (friction[1] + friction[2] * applied_rpm) * applied_rpm;
  const double inertia = c->tuning.spindle_inertia_kgm2 * RAD_PER_S_PER_RPM;
  power_measure(&c->power, at_least(in->torque_nm - friction_nm - inertia * acceleration_rpm_per_s, LEAST_TORQUE_NM));
}

static double wanted_speed_rpm(fsw_decentral *c, const fsw_decentral_input *in, double applied_rpm, double force_kn) {
  fsw_decentral_loop *l = &c->temperature;
  if (c->power.started) follow_speed(c, applied_rpm);
  measure_torque(c, in, applied_rpm);
  predictor_step(&c->predictor, c->power.now_nm * applied_rpm * KW_PER_NM_RPM, c->dt_s);
  if (!is_finite(l->output)) l->output = c->power.slow_nm * applied_rpm * KW_PER_NM_RPM;
  if (in->temperature_valid && is_finite(in->temperature_c) && is_finite(c->reference_temperature_c)) {
    const double predicted_c = in->temperature_c + c->predictor.correction_c;
    c->blind_temperature_s = 0.0;
    if (!l->started) loop_start(l, predicted_c, c->reference_temperature_c, l->output);
    loop_step(l, predicted_c, c->reference_temperature_c);
  } else {
    c->blind_temperature_s += c->dt_s;
    l->started = 0; /* the power is held */
  }
  return power_step(&c->power, l->output, applied_rpm, force_kn);
}

static int reason_of(const fsw_decentral *c) {
  if (!c->depth.started) return FSW_DECENTRAL_NO_DEPTH;
  if (c->blind_torque_s > c->tuning.blind_limit_s) return FSW_DECENTRAL_NO_TORQUE;
  if (c->blind_temperature_s > c->tuning.blind_limit_s) return FSW_DECENTRAL_NO_TEMPERATURE;
  return FSW_DECENTRAL_PROPOSING;
}

/* Nearest value to `wanted` within one step of the applied one and the bounds, which take
 * precedence. */
static double limited(double wanted, double low, double high, double applied, double step) {
  return clipped(clipped(wanted, applied - step, applied + step), low, high);
}

static int is_beyond(double x, double low, double high, double step) {
  return x < low - step - SAME || x > high + step + SAME;
}

static int touched(double x, double low, double high, double applied, double step, int min_bit, int max_bit, int rate_bit) {
  const int moves = x - applied >= step - TOUCHING || applied - x >= step - TOUCHING;
  return (x <= low + TOUCHING ? min_bit : 0) | (x >= high - TOUCHING ? max_bit : 0) | (moves ? rate_bit : 0);
}

void fsw_decentral_step(fsw_decentral *c, const fsw_decentral_input *in, fsw_decentral_output *out) {
  const fsw_decentral_tuning *t = &c->tuning;
  const double dt_s = in->dt_s > 0.0 ? at_most(in->dt_s, LONGEST_STEP_S) : FSW_DECENTRAL_TICK_S;
  if (dt_s != c->dt_s) {
    c->dt_s = dt_s;
    configure_loops(c);
  }
  const int is_known = is_finite(in->applied_force_kn + in->applied_speed_rpm);
  const double given_kn = is_known ? in->applied_force_kn : c->proposed_force_kn;
  const double given_rpm = is_known ? in->applied_speed_rpm : c->proposed_speed_rpm;
  const double applied_kn = clipped(given_kn, t->force_min_kn, t->force_max_kn);
  const double applied_rpm = clipped(given_rpm, t->speed_min_rpm, t->speed_max_rpm);
  if (is_finite(in->reference_depth_mm + in->reference_temperature_c)) {
    c->reference_depth_mm = in->reference_depth_mm;
    c->reference_temperature_c = in->reference_temperature_c;
  }
  /* The depth comes first: the speed is decoupled from the force of this same tick. */
  double force_kn = wanted_force_kn(c, in, applied_kn);
  const double next_kn = limited(force_kn, t->force_min_kn, t->force_max_kn, given_kn, t->force_step_kn);
  double speed_rpm = wanted_speed_rpm(c, in, applied_rpm, next_kn);
  out->reason = reason_of(c);
  if (!(is_within(force_kn, MOST_WANTED) && is_within(speed_rpm, MOST_WANTED))) {
    start_loops(c);
    force_kn = applied_kn;
    speed_rpm = applied_rpm;
    out->reason = FSW_DECENTRAL_OVERFLOW;
  }
  if (is_beyond(given_kn, t->force_min_kn, t->force_max_kn, t->force_step_kn) ||
      is_beyond(given_rpm, t->speed_min_rpm, t->speed_max_rpm, t->speed_step_rpm))
    out->reason = FSW_DECENTRAL_OUT_OF_BOUNDS;
  out->force_kn = limited(force_kn, t->force_min_kn, t->force_max_kn, given_kn, t->force_step_kn);
  out->speed_rpm = limited(speed_rpm, t->speed_min_rpm, t->speed_max_rpm, given_rpm, t->speed_step_rpm);
  out->healthy = out->reason == FSW_DECENTRAL_PROPOSING;
  out->active_limits = 0;
  if (out->force_kn != force_kn || out->speed_rpm != speed_rpm)
    out->active_limits = touched(out->force_kn, t->force_min_kn, t->force_max_kn, applied_kn, t->force_step_kn,
                                 FSW_DECENTRAL_FORCE_MIN, FSW_DECENTRAL_FORCE_MAX, FSW_DECENTRAL_FORCE_RATE) |
                         touched(out->speed_rpm, t->speed_min_rpm, t->speed_max_rpm, applied_rpm, t->speed_step_rpm,
                                 FSW_DECENTRAL_SPEED_MIN, FSW_DECENTRAL_SPEED_MAX, FSW_DECENTRAL_SPEED_RATE);
  c->proposed_force_kn = out->force_kn;
  c->proposed_speed_rpm = out->speed_rpm;
  if (!out->healthy && c->bad_cycles < INT_MAX) c->bad_cycles++;
  out->bad_cycles = c->bad_cycles;
  out->depth_mm = c->depth.measured;
  out->temperature_c = c->temperature.measured - c->predictor.correction_c;
  out->torque_nm = c->power.fast_nm;
}
