/* State and disturbance estimation: an extended Kalman filter on the process model (16)-(27), with
 * its dead time.
 *
 * Offset-free control needs as many integrating disturbances as there are measured outputs
 * (Pannocchia and Rawlings 2003): here of the axial force, of the heat, and of the torque's scale.
 * In addition depth and temperature have sensor offsets that leak: they absorb at once what a
 * sensor shows but the process does not feel, and pass it on to the integrators over minutes, so
 * that every state stays detectable. The offsets have rates, which leak faster, to follow ramps
 * and slow sines. The gain of the depth over the force is estimated as a factor on the model's,
 * but only while the force moves: at rest it is not observable and would drift with the noise.
 *
 * A measurement far from its expectation is a jump: the excess innovation widens the variances of
 * the states that can have jumped, and the following measurements decide which did. For the depth
 * these are the offset and the depth itself, which the torque distinguishes; the temperature of
 * the process cannot jump. A single spike is a jump there and back: waiting for a second sample
 * would delay the response to every disturbance by a tick, and the moves of one tick are too small
 * to do harm.
 *
 * Innovations of the depth with one sign for about a second are a drift (a CUSUM-like test): their
 * excess widens the variance of the offset's rate, which is small at rest, so that noise moves the
 * force little. The rate of the temperature's offset has no such test: with the dead time and a
 * wrong gain the loop would not be stable. */
#include <math.h>

#include "internal.h"

#define N FSW_STATES

/* keeps an update defined if noise and covariance are zero */
#define LEAST_VARIANCE 1e-18

enum { DEPTH, TORQUE, TEMPERATURE };

fsw_torque fsw_torque_at(const fsw_nmpc_model *m, double scale, double force_kn, double depth_mm) {
  double out[3];
  const double *arg[3] = {&force_kn, &depth_mm, m->torque_par};
  double *res[1] = {out};
  fsw_torque_casadi(arg, res);
  fsw_torque t = {scale * out[0], scale * out[1], scale * out[2]};
  return t;
}

double fsw_friction(const fsw_nmpc_model *m, double speed_rpm) {
  return m->friction[0] + (m->friction[1] + m->friction[2] * speed_rpm) * speed_rpm;
}

void fsw_estimator_walk(const fsw_estimator_tuning *t, double walk[N]) {
  const double of_states[N] = {t->creep_walk_mm, 0.0, t->copper_walk_c, 0.0, t->motor_walk_nm, t->force_walk_kn,
                               t->heat_walk_kw, t->torque_scale_walk, t->depth_offset_walk_mm, t->temperature_offset_walk_c,
                               t->depth_rate_walk_mm_per_s, t->temperature_rate_walk_c_per_s, t->depth_gain_walk};
  for (int i = 0; i < N; i++) walk[i] = of_states[i];
}

/* Depth that the tool feels, (27), and, unless row is NULL, its derivative by the states. */
double fsw_contact_depth(const fsw_estimator *e, const fsw_nmpc_model *m, double row[N]) {
  const double *x = e->x;
  const double soft = 1.0 + m->softening_per_c * x[FSW_TOOL];
  const double pushed = e->acting_force_kn + x[FSW_FORCE] - m->operating_force_kn;
  const double fast_gain = x[FSW_DEPTH_GAIN] * m->fast_gain;
  const double moved = m->operating_depth_mm + x[FSW_CREEP] + x[FSW_SLOW] + fast_gain * pushed;
  if (row) {
    for (int i = 0; i < N; i++) row[i] = 0.0;
    row[FSW_CREEP] = row[FSW_SLOW] = soft;
    row[FSW_TOOL] = m->softening_per_c * moved;
    row[FSW_FORCE] = soft * fast_gain;
    row[FSW_DEPTH_GAIN] = soft * m->fast_gain * pushed;
  }
  return soft * moved;
}

/* Difference between a drive's feedback and its command. The drive may lag: as long as the
 * feedback lies among the commands of the last ticks, there is no new information. So `offset`
 * changes no more than needed for `acting - offset` to lie among them. */
static void take_drive(fsw_estimator *e, const fsw_estimator_tuning *t, int input, double acting, double applied) {
  double *command = e->command[input], low = applied, high = applied;
  for (int k = FSW_LATEST - 1; k > 0; k--) {
    command[k] = command[k - 1];
    low = command[k] < low ? command[k] : low;
    high = command[k] > high ? command[k] : high;
  }
  if (input == 0) e->is_excited = high - low > t->excitation_force_kn;
  command[0] = applied;
  e->offset[input] = fsw_clip(e->offset[input], acting - high, acting - low);
}

/* Acting inputs: as the drives report them, else as commanded. */
static void take_inputs(fsw_estimator *e, const fsw_estimator_tuning *t, const fsw_nmpc_input *in) {
  e->acting_force_kn = fsw_is_finite(in->force_kn) ? in->force_kn : in->applied_force_kn;
  e->acting_speed_rpm = fsw_is_finite(in->speed_rpm) ? in->speed_rpm : in->applied_speed_rpm;
  take_drive(e, t, 0, e->acting_force_kn, in->applied_force_kn);
  take_drive(e, t, 1, e->acting_speed_rpm, in->applied_speed_rpm);
}

static int plausible_depth(const fsw_estimator_tuning *t, double depth_mm) {
  return depth_mm > 0.0 && depth_mm < t->depth_max_mm;
}
static int plausible_rise(const fsw_estimator_tuning *t, double rise_c) {
  return rise_c > -t->temperature_deviation_max_c && rise_c < t->temperature_deviation_max_c;
}

/* Whether states and variances are finite and plausible for a weld. */
static int is_sound(const fsw_estimator *e, const fsw_nmpc_model *m, const fsw_estimator_tuning *t) {
  double sum = 0.0;
  for (int i = 0; i < N; i++) {
    if (!(e->p[i][i] >= 0.0)) return 0;
    sum += e->x[i] + e->p[i][i];
  }
  return fsw_is_finite(sum) && plausible_depth(t, fsw_contact_depth(e, m, 0)) && plausible_rise(t, e->x[FSW_TOOL]) &&
         fabs(e->x[FSW_FORCE]) < t->force_offset_max_kn;
}

/* Start at rest from a measurement; 0 if a required sensor is missing or implausible. */
int fsw_estimator_start(fsw_estimator *e, const fsw_nmpc_model *m, const fsw_estimator_tuning *t, const fsw_nmpc_input *in) {
  const double rise_c = in->temperature_c - m->operating_temperature_c;
  if (!in->depth_fresh || !in->temperature_fresh || !plausible_depth(t, in->depth_mm) || !plausible_rise(t, rise_c)) return 0;
  *e = (fsw_estimator){0};
  for (int k = 0; k < FSW_LATEST; k++) {
    e->command[0][k] = in->applied_force_kn;
    e->command[1][k] = in->applied_speed_rpm;
  }
  take_inputs(e, t, in);
  const double torque = fsw_torque_at(m, 1.0, e->acting_force_kn, in->depth_mm).value;
  const double friction = fsw_friction(m, e->acting_speed_rpm);
  double scale = 1.0;
  if (in->torque_fresh && fsw_is_finite(in->torque_nm))
    scale = fsw_clip((in->torque_nm - friction) / torque, t->torque_scale_min, t->torque_scale_max);
  const double power = scale * torque * e->acting_speed_rpm * FSW_KW_PER_NM_RPM - m->operating_power_kw;
  const double pushed = e->acting_force_kn - m->operating_force_kn;
  double *x = e->x, walk[N];
  fsw_estimator_walk(t, walk);
  x[FSW_CREEP] = in->depth_mm / (1.0 + m->softening_per_c * rise_c) - m->operating_depth_mm - m->fast_gain * pushed;
  x[FSW_COPPER] = x[FSW_TOOL] = rise_c;
  x[FSW_MOTOR] = scale * torque + friction;
  x[FSW_DEPTH_GAIN] = 1.0;
  x[FSW_HEAT] = rise_c / m->thermal_gain_c_per_kw - power;
  x[FSW_SCALE] = scale;
  for (int i = 0; i < N; i++) /* disturbances and gains only if they may change */
    if (i < FSW_FORCE || walk[i] > 0.0) e->p[i][i] = t->start_deviation[i] * t->start_deviation[i];
  for (int k = 0; k < m->n_history; k++) e->history[3 * k] = power;
  fsw_known_heat_start(e, m, t, in);
  return e->started = is_sound(e, m, t);
}

/* Transition matrix a[] (Jacobian of one tick) except the row of the motor torque. */
static void linear_rows(fsw_estimator *e, const fsw_nmpc_model *m, const fsw_estimator_tuning *t) {
  const double *mode = m->modes, gain = e->x[FSW_DEPTH_GAIN];
  const double pushed = e->acting_force_kn + e->x[FSW_FORCE] - m->operating_force_kn;
  for (int i = 0; i < N; i++)
    for (int j = 0; j < N; j++) e->a[i][j] = i == j ? 1.0 : 0.0;
  e->a[FSW_CREEP][FSW_FORCE] = mode[0] * gain;
  e->a[FSW_CREEP][FSW_DEPTH_GAIN] = mode[0] * pushed;
  e->a[FSW_SLOW][FSW_SLOW] = mode[1];
  e->a[FSW_SLOW][FSW_FORCE] = mode[2] * gain;
  e->a[FSW_SLOW][FSW_DEPTH_GAIN] = mode[2] * pushed;
  e->a[FSW_COPPER][FSW_COPPER] = mode[5];
  e->a[FSW_TOOL][FSW_COPPER] = mode[6];
  e->a[FSW_TOOL][FSW_TOOL] = mode[7];
  e->a[FSW_COPPER][FSW_HEAT] = mode[8];
  e->a[FSW_TOOL][FSW_HEAT] = mode[9];
  e->a[FSW_DEPTH_OFFSET][FSW_DEPTH_OFFSET] = e->a[FSW_TEMP_OFFSET][FSW_TEMP_OFFSET] = t->offset_keep;
  e->a[FSW_DEPTH_OFFSET][FSW_DEPTH_RATE] = e->a[FSW_TEMP_OFFSET][FSW_TEMP_RATE] = FSW_TICK_S;
  e->a[FSW_DEPTH_RATE][FSW_DEPTH_RATE] = t->depth_rate_keep;
  e->a[FSW_TEMP_RATE][FSW_TEMP_RATE] = t->temperature_rate_keep;
}

/* Whether a state keeps its estimate and variance, because nothing excites it at present. */
static int is_held(const fsw_estimator *e, int state) { return state == FSW_DEPTH_GAIN && !e->is_excited; }

/* p = a p a' + walk */
static void predict_covariance(fsw_estimator *e, const fsw_estimator_tuning *t) {
  double ap[N][N], walk[N];
  fsw_estimator_walk(t, walk);
  for (int i = 0; i < N; i++)
    for (int j = 0; j < N; j++) {
      double sum = 0.0;
      for (int k = 0; k < N; k++) sum += e->a[i][k] * e->p[k][j];
      ap[i][j] = sum;
    }
  for (int i = 0; i < N; i++)
    for (int j = 0; j <= i; j++) {
      double sum = i == j && !is_held(e, i) ? walk[i] * walk[i] : 0.0;
      for (int k = 0; k < N; k++) sum += ap[i][k] * e->a[j][k];
      e->p[i][j] = e->p[j][i] = sum;
    }
}

/* One tick of the model, as in predict.c, and of the covariance. */
static void predict(fsw_estimator *e, const fsw_nmpc_model *m, const fsw_estimator_tuning *t, const fsw_nmpc_input *in) {
  const double *mode = m->modes, motor_decay = mode[3], lag = mode[4];
  double *x = e->x, left_row[N], right_row[N];
  const double gain = x[FSW_DEPTH_GAIN], fast_gain = gain * m->fast_gain;
  const double force = e->acting_force_kn + x[FSW_FORCE], pushed = force - m->operating_force_kn;
  const double scale = x[FSW_SCALE], settled = m->operating_depth_mm + fast_gain * pushed;

  fsw_known_heat_rise(e, t, in);
  linear_rows(e, m, t);
  const double before = fsw_contact_depth(e, m, left_row);
  const fsw_torque left = fsw_torque_at(m, 1.0, force, fmax(before, 0.0));
  for (int i = 0; i < N; i++) left_row[i] *= scale * left.by_depth;
  left_row[FSW_FORCE] += scale * left.by_force;
  left_row[FSW_SCALE] = left.value;

  double copper = x[FSW_COPPER], tool = x[FSW_TOOL];
  fsw_heat_step(mode, x[FSW_HEAT], &copper, &tool);
  for (int k = m->weight_start[0]; k < m->weight_start[1]; k++) {
    const double *g = m->weight + 6 * k, *power = e->history + 3 * m->weight_segment[k];
    copper += g[0] * power[0] + g[1] * power[1] + g[2] * power[2];
    tool += g[3] * power[0] + g[4] * power[1] + g[5] * power[2];
  }
  x[FSW_CREEP] += gain * mode[0] * pushed;
  x[FSW_SLOW] = mode[1] * x[FSW_SLOW] + gain * mode[2] * pushed;
  x[FSW_COPPER] = copper;
  x[FSW_TOOL] = tool;
  const double soft = 1.0 + m->softening_per_c * tool, moved = settled + x[FSW_CREEP] + x[FSW_SLOW];
  const fsw_torque right = fsw_torque_at(m, 1.0, force, fmax(soft * moved, 0.0));
  for (int i = 0; i < N; i++)
    right_row[i] = scale * right.by_depth *
                   (soft * (e->a[FSW_CREEP][i] + e->a[FSW_SLOW][i]) + m->softening_per_c * moved * e->a[FSW_TOOL][i]);
  right_row[FSW_FORCE] += scale * (right.by_force + right.by_depth * soft * fast_gain);
  right_row[FSW_DEPTH_GAIN] += scale * right.by_depth * soft * m->fast_gain * pushed;
  right_row[FSW_SCALE] += right.value;

  const double friction = fsw_friction(m, e->acting_speed_rpm), kw = FSW_KW_PER_NM_RPM * e->acting_speed_rpm;
  const double rise = scale * (right.value - left.value), begin = scale * left.value - lag * rise;
  const double rest = x[FSW_MOTOR] - friction - begin;
  for (int i = 0; i < N; i++) {
    const double row_rise = right_row[i] - left_row[i];
    e->a[FSW_MOTOR][i] = (1.0 - motor_decay) * (left_row[i] - lag * row_rise) + row_rise;
  }
  e->a[FSW_MOTOR][FSW_MOTOR] = motor_decay;
  x[FSW_MOTOR] = begin + rise + friction + motor_decay * rest;
  x[FSW_DEPTH_OFFSET] = t->offset_keep * x[FSW_DEPTH_OFFSET] + FSW_TICK_S * x[FSW_DEPTH_RATE];
  x[FSW_TEMP_OFFSET] = t->offset_keep * x[FSW_TEMP_OFFSET] + FSW_TICK_S * x[FSW_TEMP_RATE];
  x[FSW_DEPTH_RATE] *= t->depth_rate_keep;
  x[FSW_TEMP_RATE] *= t->temperature_rate_keep;
  for (int k = 0; k < 3 * (m->n_history - 1); k++) e->history[k] = e->history[k + 3];
  double *newest = e->history + 3 * (m->n_history - 1);
  newest[0] = kw * begin - m->operating_power_kw;
  newest[1] = kw * rise;
  newest[2] = kw * rest;
  fsw_known_heat_predict(e);
  predict_covariance(e, t);
}

/* cross = p row', and the variance row p row' of the predicted measurement */
static double spread(const fsw_estimator *e, const double row[N], double cross[N]) {
  double variance = 0.0;
  for (int i = 0; i < N; i++) {
    double sum = 0.0;
    for (int j = 0; j < N; j++) sum += e->p[i][j] * row[j];
    cross[i] = sum;
    variance += row[i] * sum;
  }
  return variance;
}

/* Scalar Kalman update with the linearised measurement `row`. A jump widens the variances of the
 * states in `jumping`, by the squares of their shares. Measurements are processed one by one, so
 * that no matrix has to be inverted and a missing sensor is simply skipped. */
static void update(fsw_estimator *e, const fsw_estimator_tuning *t, int sensor, const double row[N], double innovation,
                   double noise, const double jumping[N]) {
  double cross[N];
  double expected = spread(e, row, cross) + noise * noise + LEAST_VARIANCE;
  const double excess = innovation * innovation - t->jump_sigmas * t->jump_sigmas * expected;
  e->innovation[sensor] = innovation;
  e->expected[sensor] = expected;
  if (t->jump_sigmas > 0.0 && excess > 0.0) {
    for (int i = 0; i < N; i++) e->p[i][i] += excess * jumping[i] * jumping[i];
    expected = spread(e, row, cross) + noise * noise;
  }
  /* A held state has gain 0 but its uncertainty counts: a Schmidt (consider) filter. The update of
   * p below holds for any gain. */
  double gain[N];
  for (int i = 0; i < N; i++) gain[i] = is_held(e, i) ? 0.0 : cross[i] / expected;
  fsw_known_heat_correct(e, row, gain);
  for (int i = 0; i < N; i++) e->x[i] += gain[i] * innovation;
  for (int i = 0; i < N; i++)
    for (int j = 0; j < N; j++) e->p[i][j] -= gain[i] * cross[j] + (cross[i] - gain[i] * expected) * gain[j];
}

/* After an update of the depth: widen the variance of its rate if its innovations drift. */
static void widen_rate(fsw_estimator *e, const fsw_estimator_tuning *t) {
  const double deviation = sqrt(e->expected[DEPTH]);
  e->recent = t->drift_keep * e->recent + fsw_clip(e->innovation[DEPTH] / deviation, -t->jump_sigmas, t->jump_sigmas);
  /* of the fading sum, for white innovations */
  const double variance = 1.0 / (1.0 - t->drift_keep * t->drift_keep);
  if (!(t->drift_sigmas > 0.0 && e->recent * e->recent > t->drift_sigmas * t->drift_sigmas * variance)) return;
  const double rate = (1.0 - t->drift_keep) * e->recent * deviation; /* mean change per second */
  e->p[FSW_DEPTH_RATE][FSW_DEPTH_RATE] += rate * rate;
  e->recent = 0.0;
}

static int seen(fsw_estimator *e, int sensor, int is_valid) {
  e->blind_s[sensor] = is_valid ? 0.0 : e->blind_s[sensor] + FSW_TICK_S;
  return is_valid;
}

static void correct(fsw_estimator *e, const fsw_nmpc_model *m, const fsw_estimator_tuning *t, const fsw_nmpc_input *in,
                    double last_rpm) {
  for (int s = 0; s < 3; s++) e->innovation[s] = e->expected[s] = 0.0;

  const double peak = m->inertia_nm_s_per_rpm * (e->acting_speed_rpm - last_rpm) / FSW_TICK_S;
  const double torque = in->torque_nm - peak, expected = e->x[FSW_MOTOR];
  if (seen(e, TORQUE, in->torque_fresh && torque > expected / t->torque_outlier_factor && torque < expected * t->torque_outlier_factor)) {
    double row[N] = {0.0}, jumping[N] = {0.0};
    row[FSW_MOTOR] = 1.0;
    jumping[FSW_SCALE] = 1.0 / (expected > t->torque_min_nm ? expected : t->torque_min_nm);
    update(e, t, TORQUE, row, torque - expected, t->torque_noise_nm + t->torque_peak_noise_share * fabs(peak), jumping);
  }
  if (seen(e, DEPTH, in->depth_fresh && plausible_depth(t, in->depth_mm))) {
    double row[N], jumping[N] = {0.0};
    const double shown = fsw_contact_depth(e, m, row) + e->x[FSW_DEPTH_OFFSET];
    row[FSW_DEPTH_OFFSET] = 1.0;
    jumping[FSW_DEPTH_OFFSET] = sqrt(t->jump_offset_share);
    jumping[FSW_CREEP] = sqrt(1.0 - t->jump_offset_share);
    update(e, t, DEPTH, row, in->depth_mm - shown, t->depth_noise_mm, jumping);
    widen_rate(e, t);
  }
  const double rise_c = in->temperature_c - m->operating_temperature_c;
  if (seen(e, TEMPERATURE, in->temperature_fresh && plausible_rise(t, rise_c))) {
    double row[N] = {0.0}, jumping[N] = {0.0};
    row[FSW_TOOL] = row[FSW_TEMP_OFFSET] = jumping[FSW_TEMP_OFFSET] = 1.0;
    update(e, t, TEMPERATURE, row, rise_c - e->x[FSW_TOOL] - e->x[FSW_TEMP_OFFSET], t->temperature_noise_c, jumping);
    fsw_known_heat_judge(e, t);
  }
  e->x[FSW_DEPTH_GAIN] = fsw_clip(e->x[FSW_DEPTH_GAIN], t->depth_gain_min, t->depth_gain_max);
  e->x[FSW_SCALE] = fsw_clip(e->x[FSW_SCALE], t->torque_scale_min, t->torque_scale_max);
}

/* Advance one tick: predict with the inputs that acted during it, correct with the sensors at its
 * end. Returns whether the estimate is sound; otherwise it has ended and must be started again. */
int fsw_estimator_step(fsw_estimator *e, const fsw_nmpc_model *m, const fsw_estimator_tuning *t, const fsw_nmpc_input *in) {
  const double last_rpm = e->acting_speed_rpm;
  take_inputs(e, t, in);
  predict(e, m, t, in);
  correct(e, m, t, in, last_rpm);
  return e->started = is_sound(e, m, t);
}
