/* Reference trajectories of the outputs over the horizon.
 *
 * FSW_APPROACH: from its present value and rate, an output goes to its set-point as a second-order
 * system with two time constants; from further away it moves as fast as it can still brake (like a
 * time-optimal profile). Rate and acceleration are limited by what force and speed can do
 * together. The temperature's trajectory starts one dead time ahead, at the predicted value that
 * no present input can change; the steered quantity is the copper, which the tool follows with its
 * lag. Disturbances are thus rejected like set-point changes, and the loop has the margins of
 * internal model control (Morari and Zafiriou 1989) with the tuning's time constants as its
 * filter. Known future set-points are approached early enough that the output is half way in time.
 * Set-points that the speed's bounds exclude are replaced by the nearest attainable ones, see
 * make_attainable; the temperature's trajectory is then what the bound brings, see keep_within_reach.
 *
 * The paper's corridors (32), (33) are of first order. The text does not say where they start in
 * each cycle; its tool offers FSW_CONSTANT (at the set-point), FSW_COLD_START (once at the output,
 * then continued) and FSW_RECENTRED (at the output in every cycle). FSW_RECENTRED_AHEAD is ours:
 * the temperature's corridor starts one dead time ahead, at the predicted value. */
#include <math.h>

#include "internal.h"

/* An approach has arrived within this distance. */
#define AT_REST_MM 2e-6
#define AT_REST_C 2e-5
#define BISECTIONS 20

/* `lag_s`: of the output behind the steered quantity; 0: none. */
typedef struct {
  double slow_s, fast_s, acceleration, least_rate, top_rate, at_rest, lag_s;
  const fsw_approach_tuning *tuning;
} approach;

typedef struct { double at_s, value; } target; /* a set-point from at_s on */

typedef struct { double steered, rate, output; } motion;

/* One step of an approach to `goal`, by the trapezoidal rule. Within `near` it is linear, with the
 * two time constants; further away the speed is that from which the brakes still suffice, sqrt(2 a
 * s), continued smoothly at `near`. */
static void advance(const approach *a, motion *now, double goal, double dt_s) {
  const double distance = now->steered - goal, size = fabs(distance), before = now->steered, last = now->rate;
  const double braking = a->tuning->brake_share * a->acceleration;
  const double near = braking * a->slow_s * a->slow_s; /* within it the time constant governs */
  const double speed = size <= near ? size / a->slow_s : sqrt(2.0 * braking * (size - 0.5 * near));
  const double wanted = fsw_clip(distance < 0.0 ? speed : -speed, a->least_rate, a->top_rate);
  const double change = (wanted - last) / a->fast_s - (size <= near ? last / a->slow_s : 0.0);
  now->rate += fsw_clip(change, -a->acceleration, a->acceleration) * dt_s;
  now->steered += 0.5 * (last + now->rate) * dt_s;
  if (a->lag_s > 0.0) /* trapezoidal */
    now->output += (0.5 * (before + now->steered) - now->output) * dt_s / (a->lag_s + 0.5 * dt_s);
  else
    now->output = now->steered;
}

static int is_at_rest(const approach *a, const motion *now, double goal) {
  const double size = a->at_rest;
  return fabs(now->steered - goal) < size && fabs(now->output - goal) < size && fabs(now->rate) * a->slow_s < size;
}

/* Index of the target in force, searched from k on. */
static int target_at(const target *targets, int n_targets, int k, double now_s) {
  while (k + 1 < n_targets && targets[k + 1].at_s <= now_s + 1e-9) k++;
  return k;
}

/* Output at the points time_s[first ... n), starting at `begin_s`. */
static void follow(const approach *a, motion now, double begin_s, const target *targets, int n_targets,
                   const double *time_s, int first, int n, double *path) {
  double now_s = begin_s;
  int k = 0;
  for (int i = first; i < n; i++) {
    while (now_s < time_s[i] - 1e-9) {
      const double left_s = time_s[i] - now_s, dt_s = left_s < FSW_TICK_S ? left_s : FSW_TICK_S;
      k = target_at(targets, n_targets, k, now_s);
      if (is_at_rest(a, &now, targets[k].value)) {
        now.steered = now.output = targets[k].value;
        now.rate = 0.0;
        if (k + 1 == n_targets) break;
      } else {
        advance(a, &now, targets[k].value, dt_s);
      }
      now_s += dt_s;
    }
    now_s = time_s[i];
    path[i] = now.output;
  }
}

/* Time in which an approach covers half of the distance `size`. */
static double half_time_s(const approach *a, double size) {
  motion now = {0.0, 0.0, 0.0};
  double time_s = 0.0;
  while (fabs(now.output) < 0.5 * fabs(size) && time_s < a->tuning->longest_lead_s) {
    advance(a, &now, size, FSW_TICK_S);
    time_s += FSW_TICK_S;
  }
  return time_s;
}

/* Steady-state gain of the depth's rate over the force. */
static double rate_gain(const fsw_nmpc *c) {
  return c->estimator.x[FSW_DEPTH_GAIN] * (c->model.depth_gain[0] + c->model.depth_gain[1]);
}

/* Torque at a measured depth, with the force that holds a depth now; the slow mode changes it over
 * minutes. */
static fsw_torque held_torque(const fsw_nmpc *c, double depth_mm) {
  const fsw_nmpc_model *m = &c->model;
  const double *x = c->estimator.x, force = m->operating_force_kn - m->slow_pole * x[FSW_SLOW] / rate_gain(c);
  return fsw_torque_at(m, 1.0, force, depth_mm - x[FSW_DEPTH_OFFSET]);
}

/* Measured temperature that a speed bound (0: lowest, 1: highest) holds at a measured depth. */
static double held_temperature(const fsw_nmpc *c, int bound, double depth_mm) {
  const fsw_nmpc_model *m = &c->model;
  const double *x = c->estimator.x, speed = bound ? c->tuning.speed_max_rpm : c->tuning.speed_min_rpm;
  const double given = FSW_KW_PER_NM_RPM * (speed + c->estimator.offset[1]) * x[FSW_SCALE] * held_torque(c, depth_mm).value;
  const double power = given - m->operating_power_kw + x[FSW_HEAT];
  return m->operating_temperature_c + m->thermal_gain_c_per_kw * power + x[FSW_TEMP_OFFSET];
}

/* Replace set-points (depth, temperature) that no speed within the bounds can hold together. The
 * temperature first keeps its quality limits, then the set-point with priority is kept; the depth
 * gives way by at most its quality limit. */
static void make_attainable(const fsw_nmpc *c, double goal[2]) {
  const fsw_nmpc_tuning *t = &c->tuning;
  const double slowest = held_temperature(c, 0, goal[0]), fastest = held_temperature(c, 1, goal[0]), wanted = goal[1];
  const int bound = wanted > fastest;
  if (!(wanted < slowest || wanted > fastest) || !(slowest < fastest)) return;
  const double held = bound ? fastest : slowest, limit = fsw_clip(held, t->quality_temperature_min_c, t->quality_temperature_max_c);
  const double least = bound ? fsw_clip(limit, held, wanted) : fsw_clip(limit, wanted, held);
  const double share[3] = {0.0, 0.5, 1.0}; /* by priority */
  goal[1] = least + share[t->priority] * (wanted - least);
  if (goal[1] == held) return;
  double kept = goal[0], moved = goal[0] + (bound ? t->quality_depth_mm : -t->quality_depth_mm);
  for (int i = 0; i < BISECTIONS; i++) { /* a deeper tool generates more heat */
    const double middle = 0.5 * (kept + moved), there = held_temperature(c, bound, middle);
    if (bound ? there < goal[1] : there > goal[1]) kept = middle;
    else moved = middle;
  }
  goal[0] = moved;
  const double reached = held_temperature(c, bound, moved);
  goal[1] = bound ? fsw_clip(goal[1], held, reached) : fsw_clip(goal[1], reached, held);
}

/* Targets: attainable depth and temperature, and the temperature that was asked for; present and future ones. */
static int goals_of(const fsw_nmpc *c, const fsw_nmpc_input *in, double at_s[], double goals[][3]) {
  const int n_changes = in->n_changes < FSW_MAX_CHANGES ? in->n_changes : FSW_MAX_CHANGES;
  int n = 1;
  at_s[0] = -1e9;
  goals[0][0] = c->reference[0];
  goals[0][1] = goals[0][2] = c->reference[1];
  make_attainable(c, goals[0]);
  for (int i = 0; i < n_changes; i++) {
    const fsw_change *change = &in->change[i];
    if (!(fsw_is_finite(change->depth_mm + change->temperature_c) && change->at_s > 0.0)) continue;
    at_s[n] = change->at_s;
    goals[n][0] = change->depth_mm;
    goals[n][1] = goals[n][2] = change->temperature_c;
    make_attainable(c, goals[n++]);
  }
  return n;
}

/* Targets of output q (2: the temperature asked for), each with the time at which its approach has to begin, which is that
 * from one attainable value to the next. */
static int targets_of(const approach *a, int q, int n_goals, const double at_s[], double goals[][3], target *targets) {
  int n = 1, timed = q > 1 ? 1 : q;
  targets[0] = (target){-1e9, goals[0][q]};
  for (int i = 1, from = 0; i < n_goals; i++) {
    const double size = goals[i][timed] - goals[from][timed];
    if (size == 0.0) continue;
    targets[n] = (target){fmax(at_s[i] - half_time_s(a, size), targets[n - 1].at_s), goals[i][q]};
    from = i;
    n++;
  }
  return n;
}

/* Share of the temperature's rate at a speed bound while the depth follows its own rate, for a copper's deviation. As the
 * copper softens, the force has to decrease, and with it the torque. */
static double held_rate(const fsw_nmpc *c, double share, int bound, double copper_c, double known_kw, double depth_mm,
                        double depth_rate) {
  const fsw_nmpc_model *m = &c->model;
  const double *x = c->estimator.x, speed = bound ? c->tuning.speed_max_rpm : c->tuning.speed_min_rpm;
  const double heating = m->thermal_gain_c_per_kw / m->copper_lag_s, soft = 1.0 + m->softening_per_c * x[FSW_TOOL];
  const double kn_per_rate = depth_mm * m->softening_per_c / (soft * soft * rate_gain(c));
  const double power = m->operating_power_kw + copper_c / m->thermal_gain_c_per_kw - x[FSW_HEAT] - known_kw;
  const double given = FSW_KW_PER_NM_RPM * (speed + c->estimator.offset[1]) * x[FSW_SCALE];
  const fsw_torque held = held_torque(c, depth_mm);
  return share * heating * (given * (held.value + held.by_force * depth_rate / (soft * rate_gain(c))) - power) / (1.0 + heating * given * held.by_force * kn_per_rate);
}

/* Rates and accelerations that force and speed can achieve together, at the present state. Where the temperature asked for
 * is beyond a bound (-1: the lowest speed, 1: the highest), keep_within_reach limits its rate there. */
static void authority(const fsw_nmpc *c, double copper_c, double depth_mm, int beyond, approach *depth, approach *temp) {
  const fsw_nmpc_model *m = &c->model;
  const fsw_nmpc_tuning *t = &c->tuning;
  const double *x = c->estimator.x;
  const fsw_torque at = fsw_torque_at(m, 1.0, m->operating_force_kn, fsw_contact_depth(&c->estimator, m, 0));
  const double torque = x[FSW_SCALE] * at.value, by_force = x[FSW_SCALE] * at.by_force;
  /* power that holds the temperature */
  const double power = fmax(m->operating_power_kw + x[FSW_TOOL] / m->thermal_gain_c_per_kw - x[FSW_HEAT], t->approach.least_power_kw);
  const double kw_per_rpm = FSW_KW_PER_NM_RPM * torque, nm_rpm = power / FSW_KW_PER_NM_RPM;
  double low = t->force_min_kn, high = t->force_max_kn, force_rate = t->force_step_kn / FSW_TICK_S;
  const double speed_rate = t->speed_step_rpm / FSW_TICK_S;
  /* forces at which the highest and lowest speed give that power */
  if (by_force > 0.0 && t->speed_min_rpm > 0.0) {
    low = fmax(low, m->operating_force_kn + (nm_rpm / t->speed_max_rpm - torque) / by_force);
    high = fmin(high, m->operating_force_kn + (nm_rpm / t->speed_min_rpm - torque) / by_force);
    force_rate = fmin(force_rate, speed_rate * torque / (nm_rpm / torque * by_force));
  }
  const double gain = rate_gain(c);
  const double centre = m->operating_force_kn - x[FSW_FORCE], least_kn = t->approach.least_force_kn;
  depth->least_rate = gain * (low - centre < -least_kn ? low - centre : -least_kn);
  depth->top_rate = gain * (high - centre > least_kn ? high - centre : least_kn);
  depth->acceleration = t->approach.depth_acceleration * gain * force_rate;
  const double usual = m->operating_depth_mm; /* guards against absurd set-points */
  const double goal = fsw_clip(depth_mm, 0.5 * usual, 1.5 * usual);
  const double least = t->approach.least_rate_c_per_s, used = t->approach.rate_share;
  temp->least_rate = beyond < 0 ? -HUGE_VAL : fmin(held_rate(c, used, 0, copper_c, 0.0, goal, 0.0), -least);
  temp->top_rate = beyond > 0 ? HUGE_VAL : fmax(held_rate(c, used, 1, copper_c, 0.0, goal, 0.0), least);
  temp->acceleration = m->thermal_gain_c_per_kw / m->copper_lag_s * kw_per_rpm * speed_rate;
}

/* Present depth and its rate under the acting inputs. */
static motion depth_now(const fsw_nmpc *c) {
  const fsw_nmpc_model *m = &c->model;
  const fsw_estimator *e = &c->estimator;
  double row[FSW_STATES];
  motion now;
  now.output = now.steered = fsw_contact_depth(e, m, row) + e->x[FSW_DEPTH_OFFSET];
  const double pushed = e->acting_force_kn + e->x[FSW_FORCE] - m->operating_force_kn;
  const double own = rate_gain(c) * pushed + m->slow_pole * e->x[FSW_SLOW];
  const double softer = row[FSW_TOOL] * (e->x[FSW_COPPER] - e->x[FSW_TOOL]) / m->tool_lag_s;
  now.rate = row[FSW_CREEP] * own + softer + e->x[FSW_DEPTH_RATE];
  return now;
}

/* Copper and tool, as the sensor would show them, one dead time from now, and the copper's rate
 * then under the present power: no present input can change them. `copper_c` gets the copper's
 * deviation without offset. */
static motion temperature_ahead(const fsw_nmpc *c, double *copper_c) {
  const fsw_nmpc_model *m = &c->model;
  const fsw_estimator *e = &c->estimator;
  const double *mode = m->ahead_mode, *x = e->x, *newest = e->history + 3 * (m->n_history - 1);
  const int n = 3 * m->n_history;
  double copper = x[FSW_COPPER], tool = x[FSW_TOOL];
  fsw_heat_step(mode, x[FSW_HEAT], &copper, &tool);
  for (int k = 0; k < n; k++) {
    copper += m->ahead_power[k] * c->problem.start.history[k];
    tool += m->ahead_power[n + k] * c->problem.start.history[k];
  }
  double known_kw = 0.0; /* over the last step of the dead time; earlier ones heat as they do in the prediction */
  double known_copper = 0.0, known_tool = 0.0;
  for (int k = 0; k < m->n_steps && m->time_s[m->step_interval[k]] <= m->dead_time_s + 1e-9; k++) {
    const double *step = m->modes + k * FSW_MODES;
    known_kw = c->problem.start.heat_ahead_kw[k];
    fsw_heat_step(step, known_kw, &known_copper, &known_tool);
  }
  copper += known_copper;
  tool += known_tool;
  const double power = newest[0] + newest[1] + newest[2] * m->modes[3] + x[FSW_HEAT] + known_kw;
  double drift = 0.0, rate = x[FSW_TEMP_RATE];
  for (double now_s = 0.0; now_s < m->dead_time_s - 0.5 * FSW_TICK_S; now_s += FSW_TICK_S) {
    drift += FSW_TICK_S * rate;
    rate *= c->tuning.estimator.temperature_rate_keep;
  }
  const double shown = m->operating_temperature_c + x[FSW_TEMP_OFFSET] + drift;
  motion ahead = {shown + copper, rate + (m->thermal_gain_c_per_kw * power - copper) / m->copper_lag_s, shown + tool};
  *copper_c = copper;
  return ahead;
}

/* Initial rate of an approach: a mean of the actual rate and of the rate planned at the last tick.
 * While one output gives way to the other, the actual rate alone would lag at every tick. */
static void keep_rate(fsw_nmpc *c, const approach *a, int q, motion *now, double begin_s, const target *targets,
                      int n_targets) {
  const double keep = q ? c->tuning.approach.temperature_approach_keep : c->tuning.approach.depth_approach_keep;
  if (c->has_rate) now->rate += keep * (c->rate[q] - now->rate);
  motion next = *now;
  advance(a, &next, targets[target_at(targets, n_targets, 0, begin_s)].value, FSW_TICK_S);
  c->rate[q] = next.rate;
}

/* Limit the temperature's path to what a speed bound brings, from one dead time ahead on, while the depth follows its own
 * path. Known heat counts as in the prediction: otherwise the speed would leave the bound before heat that is to come, and
 * the depth give way before heat that is to go. */
static void keep_within_reach(const fsw_nmpc *c, int bound, const double *depth, double copper_c, const motion *ahead, int first,
                              double *path) {
  const fsw_nmpc_model *m = &c->model;
  const double shown = ahead->steered - copper_c;
  double tool_c = ahead->output - shown, beyond_kw = (bound ? 1.0 : -1.0) * c->tuning.approach.beyond_bound_kw;
  for (int k = 0, at = 0; k < m->n_steps; k++) {
    const int i = m->step_interval[k];
    const double *step = m->modes + k * FSW_MODES, known_kw = c->problem.start.heat_ahead_kw[k] + beyond_kw;
    if (i < first) continue;
    while (m->time_s[at] < m->time_s[i] - m->dead_time_s - 1e-9) at++;
    const double depth_rate = at ? (depth[at] - depth[at - 1]) / (m->time_s[at] - m->time_s[at - 1]) : 0.0;
    const double rate = held_rate(c, 1.0, bound, copper_c, known_kw, depth[at], depth_rate);
    const double power = (copper_c + rate * m->copper_lag_s) / m->thermal_gain_c_per_kw;
    fsw_heat_step(step, power, &copper_c, &tool_c);
    if (m->out_step[i] == k) path[i] = bound ? fmin(path[i], shown + tool_c) : fmax(path[i], shown + tool_c);
  }
}

static void approaches(fsw_nmpc *c, const fsw_nmpc_input *in, double *depth, double *temp) {
  const fsw_nmpc_model *m = &c->model;
  const fsw_nmpc_tuning *t = &c->tuning;
  approach to_depth = {t->depth_time_s, t->approach.force_time_s, 0.0, 0.0, 0.0, AT_REST_MM, 0.0, &t->approach};
  approach to_temp = {t->temperature_time_s, t->approach.power_time_s, 0.0, 0.0, 0.0, AT_REST_C, m->tool_lag_s, &t->approach};
  target targets[FSW_MAX_CHANGES + 1];
  double copper_c, at_s[FSW_MAX_CHANGES + 1], goals[FSW_MAX_CHANGES + 1][3];
  const int n_goals = goals_of(c, in, at_s, goals);
  motion ahead = temperature_ahead(c, &copper_c);
  for (int q = 0; q < 2; q++) c->attainable[q] = goals[0][q];
  const int beyond = (c->attainable[1] < c->reference[1]) - (c->attainable[1] > c->reference[1]);
  authority(c, copper_c, goals[0][0], beyond, &to_depth, &to_temp);
  int n = targets_of(&to_depth, 0, n_goals, at_s, goals, targets);
  motion now = depth_now(c);
  keep_rate(c, &to_depth, 0, &now, 0.0, targets, n);
  follow(&to_depth, now, 0.0, targets, n, m->time_s, 0, m->n_out, depth);

  int first = 0;
  while (first < m->n_out && m->time_s[first] <= m->dead_time_s + 1e-9) temp[first++] = ahead.output;
  n = targets_of(&to_temp, beyond ? 2 : 1, n_goals, at_s, goals, targets);
  keep_rate(c, &to_temp, 1, &ahead, m->dead_time_s, targets, n);
  c->has_rate = 1;
  follow(&to_temp, ahead, m->dead_time_s, targets, n, m->time_s, first, m->n_out, temp);
  if (beyond) keep_within_reach(c, beyond > 0, depth, copper_c, &ahead, first, temp);
}

/* Centre of the corridor of output q; `output` is its value at `begin_s`, where it starts. */
static void corridor(fsw_nmpc *c, int q, double begin_s, double output, double *path) {
  const fsw_nmpc_tuning *t = &c->tuning;
  const double goal = c->reference[q], keep = q ? t->temperature_corridor_keep : t->depth_corridor_keep;
  if (t->trajectory == FSW_CONSTANT) c->corridor[q] = goal;
  else if (t->trajectory >= FSW_RECENTRED || !c->has_corridor) c->corridor[q] = output;
  else c->corridor[q] = goal + (c->corridor[q] - goal) * keep;
  double left = c->corridor[q] - goal, now_s = begin_s;
  for (int i = 0; i < c->model.n_out; i++) {
    for (; now_s < c->model.time_s[i] - 0.5 * FSW_TICK_S; now_s += FSW_TICK_S) left *= keep;
    path[i] = goal + left;
  }
}

/* Dead-bands about this tick's trajectories, into c->problem. */
void fsw_trajectories(fsw_nmpc *c, const fsw_nmpc_input *in) {
  double path[2][FSW_MAX_OUT];
  if (c->tuning.trajectory == FSW_APPROACH) {
    approaches(c, in, path[0], path[1]);
  } else {
    const double *x = c->estimator.x;
    double copper_c;
    corridor(c, 0, 0.0, fsw_contact_depth(&c->estimator, &c->model, 0) + x[FSW_DEPTH_OFFSET], path[0]);
    if (c->tuning.trajectory == FSW_RECENTRED_AHEAD)
      corridor(c, 1, c->model.dead_time_s, temperature_ahead(c, &copper_c).output, path[1]);
    else
      corridor(c, 1, 0.0, c->model.operating_temperature_c + x[FSW_TOOL] + x[FSW_TEMP_OFFSET], path[1]);
    c->has_corridor = 1;
  }
  const double dead_band[2] = {c->tuning.dead_band_depth_mm, c->tuning.dead_band_temperature_c};
  for (int q = 0; q < 2; q++)
    for (int i = 0; i < c->model.n_out; i++) {
      c->problem.low[q][i] = path[q][i] - dead_band[q];
      c->problem.high[q][i] = path[q][i] + dead_band[q];
    }
}
