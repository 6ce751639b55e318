/* One tick of the controller: estimate, pose the problem, solve it, accept the solution or fall
 * back, enforce the limits. */
#include <limits.h>
#include <math.h>
#include <stddef.h>

#include "internal.h"

/* a longer gap in the ticks is not bridged by prediction: the estimator restarts */
#define LONGEST_GAP_S 3.0
#define LONGEST_HORIZON_S 600.0
#define MOST_ITERATIONS 200
/* distance from a bound (kN, rpm) that counts as rounding of the unit conversion */
#define ROUNDED 1e-6
/* tolerated violation of a limit by a solution, as a share of the largest move; the proposal
 * itself is clipped */
#define ACCEPTED 1e-6
/* where the numbers of a model begin, which are its last members */
#define NUMBERS offsetof(fsw_nmpc_model, ahead_mode)

#ifndef FSW_NMPC_ID
#define FSW_NMPC_ID "unknown"
#endif
const char *fsw_nmpc_id(void) { return FSW_NMPC_ID; }

static int rises_to(const int *values, int n, int most) {
  for (int i = 0; i < n; i++)
    if (values[i] < (i ? values[i - 1] : 0) || values[i] > most) return 0;
  return 1;
}

/* Whether a model fits the compiled sizes, and its tables are consistent. */
static int fits(const fsw_nmpc_model *m) {
  const int n = m->n_blocks, nv = 2 * n;
  if (!m->step_interval || !m->interval_block || !m->interval_ticks || !m->block_reach || !m->out_step || !m->depth_width ||
      !m->temperature_width || !m->time_s || !m->modes || !m->weight_start || !m->weight_segment || !m->weight ||
      !m->ahead_power || !m->torque_par)
    return 0;
  if (n < 1 || n > FSW_MAX_BLOCKS || m->n_out < 1 || m->n_out > FSW_MAX_OUT || m->n_steps < 1) return 0;
  if (m->n_steps > FSW_MAX_STEPS || m->n_history < 1 || m->n_history > FSW_MAX_HISTORY || m->n_weights < 0) return 0;
  if (!rises_to(m->step_interval, m->n_steps, m->n_out - 1) || !rises_to(m->interval_block, m->n_out, n - 1)) return 0;
  if (!rises_to(m->out_step, m->n_out, m->n_steps - 1) || !rises_to(m->depth_width, m->n_out, nv)) return 0;
  if (!rises_to(m->temperature_width, m->n_out, nv) || !rises_to(m->weight_start, m->n_steps + 1, m->n_weights)) return 0;
  if (m->interval_block[m->n_out - 1] != n - 1 || m->weight_start[m->n_steps] != m->n_weights) return 0;
  for (int i = 1; i < m->n_out; i++)
    if (m->interval_block[i] > m->interval_block[i - 1] + 1) return 0;
  for (int k = 0; k < m->n_steps; k++)
    /* a step uses only power that is known by then */
    for (int e = m->weight_start[k]; e < m->weight_start[k + 1]; e++)
      if (m->weight_segment[e] < 0 || m->weight_segment[e] >= m->n_history + k) return 0;
  return 1;
}

/* Sum of a table; not finite if one of its values is not. */
static double total(const double *values, int n) {
  double sum = 0.0;
  for (int i = 0; i < n; i++) sum += values[i];
  return sum;
}

/* Whether a model of valid sizes has finite values and a finite horizon. */
static int is_finite_model(const fsw_nmpc_model *m) {
  const double positive[4] = {m->thermal_gain_c_per_kw, m->copper_lag_s, m->tool_lag_s, m->dead_time_s};
  double sum = total((const double *)((const char *)m + NUMBERS), (int)((sizeof *m - NUMBERS) / sizeof(double)));
  sum += total(m->torque_par, 6) + total(m->modes, m->n_steps * FSW_MODES) + total(m->weight, 6 * m->n_weights);
  sum += total(m->ahead_power, 6 * m->n_history) + total(m->block_reach, m->n_blocks) + total(m->interval_ticks, m->n_out);
  for (int i = 0; i < 4; i++)
    if (!(positive[i] > 0.0)) return 0;
  for (int b = 0; b < m->n_blocks; b++)
    if (!(m->block_reach[b] > 0.0)) return 0;
  for (int i = 0; i < m->n_out; i++) {
    if (!(m->interval_ticks[i] > 0.5) || !(m->time_s[i] > (i ? m->time_s[i - 1] : 0.0))) return 0;
    if (m->time_s[i] > LONGEST_HORIZON_S) return 0;
  }
  return fsw_is_finite(sum);
}

/* Whether a tuning makes sense: finite, non-negative, and its choices known. */
static int is_usable(const fsw_nmpc_tuning *t) {
  const double *numbers = (const double *)t; /* the struct begins with all its numbers, without padding */
  for (size_t k = 0; k < offsetof(fsw_nmpc_tuning, trajectory) / sizeof(double); k++)
    if (!(numbers[k] >= 0.0 && fsw_is_finite(numbers[k]))) return 0;
#define COMPARE(share) if (t->share > 1.0) return 0;
  FSW_EACH_SHARE(COMPARE)
  for (int q = 0; q < 2; q++)
    if (!(fsw_reach(t, q) > 0.0) || !(fsw_least(t, q) < fsw_most(t, q))) return 0;
  if (!(t->approach.force_time_s > 0.0 && t->approach.power_time_s > 0.0 && t->approach.longest_lead_s <= LONGEST_HORIZON_S)) return 0;
  if (!(t->estimator.torque_outlier_factor >= 1.0 && t->estimator.torque_min_nm > 0.0)) return 0;
  if (!(t->estimator.known_heat_evidence > 0.0)) return 0;
  if (!(t->estimator.drift_keep < 1.0)) return 0;
  if (t->trajectory == FSW_APPROACH && !(t->depth_time_s >= FSW_TICK_S && t->temperature_time_s >= FSW_TICK_S)) return 0;
  if (t->trajectory < FSW_APPROACH || t->trajectory > FSW_RECENTRED_AHEAD) return 0;
  if (t->priority < FSW_KEEP_DEPTH || t->priority > FSW_KEEP_TEMPERATURE) return 0;
  if (t->quality_temperature_min_c > t->quality_temperature_max_c) return 0;
  return t->max_iterations >= 1 && t->max_iterations <= MOST_ITERATIONS && t->plan_reuse >= 0;
}

int fsw_nmpc_init(fsw_nmpc *c, const fsw_nmpc_model *model, const fsw_nmpc_tuning *tuning) {
  if (!fits(model) || !is_finite_model(model) || !is_usable(tuning)) return 1;
  c->model = *model;
  c->tuning = *tuning;
  c->bad_cycles = 0;
  for (int q = 0; q < 2; q++) c->applied[q] = 0.5 * (fsw_least(tuning, q) + fsw_most(tuning, q));
  fsw_nmpc_reset(c, model->operating_force_kn, 0.5 * (tuning->speed_min_rpm + tuning->speed_max_rpm));
  return 0;
}

int fsw_nmpc_configure(fsw_nmpc *c, const fsw_nmpc_tuning *tuning) {
  if (!is_usable(tuning)) return 1;
  c->tuning = *tuning;
  return 0;
}

/* Forget the plan: the next solve starts from no moves, and its failure has nothing to fall back on. */
static void clear_plan(fsw_nmpc *c) {
  for (int j = 0; j < 2 * c->model.n_blocks; j++) c->plan.moves[j] = c->plan.start[j] = 0.0;
  c->plan.is_cold = 1;
  c->plan.has_outputs = 0;
}

/* Distance of the applied input from its bounds; positive outside. */
static double outside(const fsw_nmpc *c, int q) {
  const double above = c->unclipped[q] - fsw_most(&c->tuning, q), below = fsw_least(&c->tuning, q) - c->unclipped[q];
  return above > below ? above : below;
}

/* Whether no command is both within the bounds and within one move of the applied one. */
static int is_out_of_bounds(const fsw_nmpc *c) {
  for (int q = 0; q < 2; q++)
    if (outside(c, q) > fsw_reach(&c->tuning, q) + ROUNDED) return 1;
  return 0;
}

/* Take the command in force, or keep the last one if it is not finite. `unclipped` is the raw
 * value; `applied`, which all computations use, is clipped to the bounds, and keeps its last value
 * if the command is implausibly far outside. */
static void take_applied(fsw_nmpc *c, double force_kn, double speed_rpm) {
  const double command[2] = {force_kn, speed_rpm};
  const int is_known = fsw_is_finite(force_kn + speed_rpm);
  for (int q = 0; q < 2; q++) c->unclipped[q] = is_known ? command[q] : c->applied[q];
  const int is_believed = !is_out_of_bounds(c);
  for (int q = 0; q < 2; q++)
    c->applied[q] = fsw_clip(is_believed ? c->unclipped[q] : c->applied[q], fsw_least(&c->tuning, q), fsw_most(&c->tuning, q));
}

/* Nearest value to `wanted` within one move of the applied one and the bounds, which take
 * precedence. */
static double limited(const fsw_nmpc *c, int q, double wanted) {
  const fsw_nmpc_tuning *t = &c->tuning;
  const double near = fsw_clip(wanted, c->unclipped[q] - fsw_reach(t, q), c->unclipped[q] + fsw_reach(t, q));
  return fsw_clip(near, fsw_least(t, q), fsw_most(t, q));
}

/* NAN and 0 mean "not given", so that a caller who sets only what is known does not command by
 * leftovers of the last tick. */
void fsw_nmpc_input_clear(fsw_nmpc_input *in) {
  *in = (fsw_nmpc_input){0};
  in->depth_mm = in->torque_nm = in->temperature_c = in->force_kn = in->speed_rpm = NAN;
  in->applied_force_kn = in->applied_speed_rpm = in->reference_depth_mm = in->reference_temperature_c = NAN;
  in->dt_s = FSW_TICK_S;
  for (int i = 0; i < FSW_MAX_CHANGES; i++) in->change[i].at_s = in->change[i].depth_mm = in->change[i].temperature_c = NAN;
}

void fsw_nmpc_reset(fsw_nmpc *c, double force_kn, double speed_rpm) {
  c->estimator.started = 0;
  c->has_corridor = c->has_rate = c->has_reference = 0;
  c->bad_in_a_row = 0;
  c->late_s = 0.0;
  take_applied(c, force_kn, speed_rpm);
  clear_plan(c);
}

/* Bring the estimator to this tick, by pure prediction over missed ones; 0 until it starts. The
 * model is discrete in ticks: `late_s` keeps what is left of a jittering dt_s, so that rounding does
 * not accumulate. After a long gap the prediction would be worse than a start from the samples. */
static int estimate(fsw_nmpc *c, const fsw_nmpc_input *in) {
  const double dt_s = in->dt_s > 0.0 ? in->dt_s : FSW_TICK_S;
  const int is_gap = !(dt_s < LONGEST_GAP_S);
  fsw_nmpc_input now = *in;
  now.applied_force_kn = c->applied[0];
  now.applied_speed_rpm = c->applied[1];
  c->late_s += is_gap ? LONGEST_GAP_S : dt_s;
  int ticks = (int)(c->late_s / FSW_TICK_S + 0.5);
  c->late_s -= ticks * FSW_TICK_S;
  if (c->estimator.started && ticks * FSW_TICK_S < LONGEST_GAP_S) {
    fsw_nmpc_input nothing = now;
    nothing.depth_fresh = nothing.torque_fresh = nothing.temperature_fresh = 0;
    for (; ticks > 0; ticks--)
      if (!fsw_estimator_step(&c->estimator, &c->model, &c->tuning.estimator, ticks > 1 ? &nothing : &now)) break;
    if (c->estimator.started) return 1;
    clear_plan(c);
  }
  c->has_corridor = c->has_rate = 0;
  c->late_s = 0.0;
  return fsw_estimator_start(&c->estimator, &c->model, &c->tuning.estimator, &now);
}

/* Movement of the two offsets over the horizon while their rates decay: a ramp that has been
 * observed is extrapolated, but not indefinitely, as few disturbances keep their slope. */
static void take_drifts(fsw_nmpc *c) {
  const double *x = c->estimator.x;
  const double keep[2] = {c->tuning.estimator.depth_rate_keep, c->tuning.estimator.temperature_rate_keep};
  double drift[2] = {0.0, 0.0}, rate[2] = {x[FSW_DEPTH_RATE], x[FSW_TEMP_RATE]}, now_s = 0.0;
  for (int i = 0; i < c->model.n_out; i++) {
    for (; now_s < c->model.time_s[i] - 0.5 * FSW_TICK_S; now_s += FSW_TICK_S)
      for (int q = 0; q < 2; q++) {
        drift[q] += FSW_TICK_S * rate[q];
        rate[q] *= keep[q];
      }
    for (int q = 0; q < 2; q++) c->problem.start.drift[q][i] = drift[q];
  }
}

/* The optimal control problem of this tick: estimated states and disturbances as its start, then
 * what is known beforehand (heat, set-points). Without an offset in the outputs the predicted steady
 * state would differ from the measured one (offset-free MPC, Pannocchia and Rawlings 2003). */
static void pose(fsw_nmpc *c, const fsw_nmpc_input *in) {
  fsw_start *s = &c->problem.start;
  const double *x = c->estimator.x;
  for (int i = 0; i < FSW_STATES; i++) s->x[i] = x[i];
  for (int k = 0; k < 3 * c->model.n_history; k++) s->history[k] = c->estimator.history[k];
  s->force_kn = c->applied[0];
  s->speed_rpm = c->applied[1];
  s->x[FSW_FORCE] += c->estimator.offset[0];
  s->speed_offset_rpm = c->estimator.offset[1];
  take_drifts(c);
  fsw_known_heat_ahead(c, in);
  fsw_trajectories(c, in);
}

static void report_estimates(const fsw_nmpc *c, fsw_nmpc_output *out) {
  const fsw_estimator *e = &c->estimator;
  out->depth_mm = fsw_contact_depth(e, &c->model, 0) + e->x[FSW_DEPTH_OFFSET];
  out->temperature_c = c->model.operating_temperature_c + e->x[FSW_TOOL] + e->x[FSW_TEMP_OFFSET];
  out->torque_nm = e->x[FSW_MOTOR];
  out->copper_c = c->model.operating_temperature_c + e->x[FSW_COPPER];
  for (int i = 0; i < FSW_ESTIMATES; i++) {
    out->disturbance[i] = e->x[FSW_FORCE + i];
    out->deviation[i] = sqrt(e->p[FSW_FORCE + i][FSW_FORCE + i]);
  }
}

int fsw_nmpc_begin(fsw_nmpc *c, const fsw_nmpc_input *in, fsw_nmpc_output *out) {
  take_applied(c, in->applied_force_kn, in->applied_speed_rpm);
  if (fsw_is_finite(in->reference_depth_mm) && fsw_is_finite(in->reference_temperature_c)) {
    c->reference[0] = in->reference_depth_mm;
    c->reference[1] = in->reference_temperature_c;
    c->has_reference = 1;
  }
  *out = (fsw_nmpc_output){0};
  out->force_kn = limited(c, 0, c->applied[0]);
  out->speed_rpm = limited(c, 1, c->applied[1]);
  out->solve_status = FSW_NOT_SOLVED;
  out->bad_cycles = c->bad_cycles;
  out->bad_in_a_row = c->bad_in_a_row;
  for (int q = 0; q < 2; q++) out->attainable[q] = c->attainable[q] = c->reference[q];
  out->reason = FSW_WAITING_FOR_SENSORS;
  if (!estimate(c, in)) return 0;
  report_estimates(c, out);
  out->reason = FSW_WAITING_FOR_REFERENCE;
  if (!c->has_reference) return 0;
  pose(c, in);
  for (int q = 0; q < 2; q++) out->attainable[q] = c->attainable[q];
  return 1;
}

/* Why a solution cannot be used: FSW_OK if it is finite and within all limits. The check does not
 * rely on the solver: it repeats the limits from the tuning, move by move. */
static int judge(const fsw_nmpc *c, const double *moves, const double *depth, const double *temp) {
  const fsw_nmpc_model *m = &c->model;
  const fsw_nmpc_tuning *t = &c->tuning;
  if (!fsw_is_finite(total(moves, 2 * m->n_blocks) + total(depth, m->n_out) + total(temp, m->n_out))) return FSW_NOT_FINITE;
  for (int q = 0; q < 2; q++) {
    const double slack = ACCEPTED * fsw_reach(t, q);
    const double low = fsw_least(t, q), high = fsw_most(t, q);
    double input = c->applied[q];
    for (int i = 0; i < m->n_out; i++) {
      const int b = m->interval_block[i];
      const double move = moves[2 * b + q], most = fsw_reach(t, q) * m->block_reach[b];
      if (move > most + slack || move < -most - slack) return FSW_TOO_FAST;
      input += move;
      if (i + 1 < m->n_out && m->interval_block[i + 1] == m->interval_block[i]) continue;
      if (input > high + m->n_out * slack) return FSW_OUTSIDE_BOUNDS;
      if (input < low - m->n_out * slack) return FSW_OUTSIDE_BOUNDS;
    }
  }
  return FSW_OK;
}

/* Outputs of the plan one tick later, interpolated at the points of the horizon. */
static void shift_outputs(fsw_nmpc *c) {
  const double *time_s = c->model.time_s;
  const int n = c->model.n_out;
  for (int q = 0; q < 2; q++) {
    double *y = c->plan.output[q];
    for (int i = 0; i + 1 < n; i++) { /* in place: each point only needs its right neighbour */
      const double share = FSW_TICK_S / (time_s[i + 1] - time_s[i]);
      y[i] += (y[i + 1] - y[i]) * (share < 1.0 ? share : 1.0);
    }
  }
}

/* Shift the plan by one tick: an interval keeps its move, except for the part that has moved into
 * the interval before it; a block gets the mean of its intervals. This warm start is what makes
 * one iteration per tick sufficient. */
static void shift_plan(fsw_nmpc *c) {
  const fsw_nmpc_model *m = &c->model;
  fsw_plan *p = &c->plan;
  double sum[FSW_MAX_VARS] = {0.0};
  int size[FSW_MAX_BLOCKS] = {0};
  for (int i = 0; i < m->n_out; i++) {
    const int b = m->interval_block[i], next = i + 1 < m->n_out ? m->interval_block[i + 1] : b;
    const double gone = 1.0 / m->interval_ticks[i], come = i + 1 < m->n_out ? 1.0 / m->interval_ticks[i + 1] : 0.0;
    size[b]++;
    for (int q = 0; q < 2; q++) sum[2 * b + q] += (1.0 - gone) * p->moves[2 * b + q] + come * p->moves[2 * next + q];
  }
  for (int j = 0; j < 2 * m->n_blocks; j++) {
    p->moves[j] = sum[j] / size[j / 2];
    p->start[j] = p->is_cold ? 0.0 : p->moves[j];
  }
  if (p->is_cold && p->has_outputs) shift_outputs(c);
}

static void report_plan(const fsw_nmpc *c, fsw_nmpc_output *out) {
  const fsw_nmpc_model *m = &c->model;
  double force = c->applied[0], speed = c->applied[1];
  out->has_plan = c->plan.has_outputs;
  for (int i = 0; i < m->n_out; i++) {
    force += c->plan.moves[2 * m->interval_block[i]];
    speed += c->plan.moves[2 * m->interval_block[i] + 1];
    out->plan_force_kn[i] = force;
    out->plan_speed_rpm[i] = speed;
    out->plan_depth_mm[i] = c->plan.output[0][i];
    out->plan_temperature_c[i] = c->plan.output[1][i];
  }
}

/* Take the solution, or the shifted last plan for up to `plan_reuse` ticks, and make the proposal.
 * The plan is optimal for the old measurement, so it is better than no move for a few ticks, but
 * blind to new disturbances; beyond that the proposal is unhealthy and the supervisor decides. */
void fsw_nmpc_end(fsw_nmpc *c, const double *moves, const double *depth, const double *temp, int status,
                  fsw_nmpc_output *out) {
  const fsw_nmpc_model *m = &c->model;
  fsw_plan *p = &c->plan;
  out->solve_status = status == FSW_OK ? judge(c, moves, depth, temp) : status;
  out->reason = FSW_PROPOSING;
  if (out->solve_status == FSW_OK) {
    for (int j = 0; j < 2 * m->n_blocks; j++) p->moves[j] = moves[j];
    for (int i = 0; i < m->n_out; i++) {
      p->output[0][i] = depth[i];
      p->output[1][i] = temp[i];
    }
    p->is_cold = 0;
    p->has_outputs = 1;
    c->bad_in_a_row = 0;
  } else {
    p->is_cold = 1; /* restart from rest: the start may have been the cause of the failure */
    if (c->bad_in_a_row < INT_MAX) c->bad_in_a_row++;
    if (c->bad_cycles < INT_MAX) c->bad_cycles++;
    out->reason = FSW_SOLVER_FAILED;
  }
  for (int s = 0; s < 3; s++)
    if (c->estimator.blind_s[s] > c->tuning.blind_limit_s + 1e-9) out->blind |= 1 << s;
  if (out->blind) out->reason = FSW_BLIND;
  if (is_out_of_bounds(c)) out->reason = FSW_OUT_OF_BOUNDS;
  const int is_reused = p->has_outputs && c->bad_in_a_row <= c->tuning.plan_reuse;
  out->healthy = out->reason == FSW_PROPOSING || (out->reason == FSW_SOLVER_FAILED && is_reused);
  out->bad_cycles = c->bad_cycles;
  out->bad_in_a_row = c->bad_in_a_row;
  out->force_kn = limited(c, 0, c->applied[0] + p->moves[0]);
  out->speed_rpm = limited(c, 1, c->applied[1] + p->moves[1]);
  report_plan(c, out);
  shift_plan(c);
}

/* Whether the first move is so far from the linearisation that a second solve is worthwhile. */
static int is_far(const fsw_nmpc *c, const double *moves, const double *about) {
  for (int q = 0; q < 2; q++)
    if (fabs(moves[q] - about[q]) > c->tuning.second_solve_distance * fsw_reach(&c->tuning, q)) return 1;
  return 0;
}

/* Real-time iteration (Diehl, Bock and Schloeder 2005): one QP about the shifted last plan,
 * instead of iterating the nonlinear problem to convergence. It is repeated about its solution if
 * that is far away, or from rest if it failed. */
void fsw_nmpc_step(fsw_nmpc *c, const fsw_nmpc_input *in, fsw_nmpc_output *out) {
  double v[FSW_MAX_VARS], about[FSW_MAX_VARS], depth[FSW_MAX_OUT], temp[FSW_MAX_OUT];
  const int nv = 2 * c->model.n_blocks;
  if (!fsw_nmpc_begin(c, in, out)) return;
  for (int j = 0; j < nv; j++) v[j] = c->plan.start[j];
  int status = FSW_OK, iterations = 0;
  for (int attempt = 0; attempt < 2; attempt++) {
    double size = 0.0;
    for (int j = 0; j < nv; j++) {
      about[j] = v[j];
      size += fabs(v[j]);
    }
    status = fsw_solve(c, &c->problem, v, depth, temp, out);
    iterations += out->iterations;
    if (status == FSW_OK) status = judge(c, v, depth, temp);
    if (status == FSW_OK ? iterations > c->tuning.second_solve_iterations || !is_far(c, v, about) : size == 0.0) break;
    if (status != FSW_OK)
      for (int j = 0; j < nv; j++) v[j] = 0.0;
  }
  out->iterations = iterations;
  fsw_nmpc_end(c, v, depth, temp, status, out);
}
