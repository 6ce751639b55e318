#include "fsw_plant.h"

#include <math.h>
#include <string.h>

#include "equations.h"
#include "plant.h"

enum { FORCE, SPEED };
enum { DEPTH, TORQUE, TEMPERATURE };

#ifndef FSW_PLANT_ID
#define FSW_PLANT_ID "unknown"
#endif
const char *fsw_plant_id(void) { return FSW_PLANT_ID; }

/* What a first-order lag leaves of a deviation after a tick, and its mean over the tick. Both are
 * exact for a set-point that is held over the tick, so no smaller steps are needed. */
static double lag_left(double lag_s) { return lag_s > 0.0 ? exp(-STEP_S / lag_s) : 0.0; }
static double lag_mean(double lag_s) { return lag_s / STEP_S * (1.0 - lag_left(lag_s)); }

/* Another length of a queue, the oldest first, which new ones repeat. */
static void resize(double *queue, int before, int after, double oldest) {
  const int more = after - before;
  if (more > 0) memmove(queue + more, queue, (size_t)before * sizeof *queue);
  else memmove(queue, queue - more, (size_t)after * sizeof *queue);
  for (int k = 0; k < more; k++) queue[k] = oldest;
}

void fsw_plant_drive_configure(fsw_plant_drive *d, double largest_step, double lag_s,
                               int dead_ticks) {
  resize(d->on_the_way, d->dead_ticks, dead_ticks, d->setpoint);
  d->dead_ticks = dead_ticks;
  d->largest_step = largest_step;
  d->left = lag_left(lag_s), d->mean = lag_mean(lag_s);
}

void fsw_plant_probe_configure(fsw_plant_probe *p, double lag_s) {
  p->left = lag_left(lag_s), p->mean = lag_mean(lag_s);
  p->is_slow = lag_s > 0.0;
}

void fsw_plant_machine_configure(fsw_plant_machine *g, double tool_s, double canister_s) {
  g->tool_left = lag_left(tool_s), g->canister_left = lag_left(canister_s);
}

void fsw_plant_sensor_configure(fsw_plant_sensor *s, double deviation, double resolution,
                                double correlation_s) {
  s->deviation = deviation, s->resolution = resolution, s->kept = lag_left(correlation_s);
}

/* In the order of the signal: sticking, delay of the fieldbus, largest step, lag. Returns the mean
 * over the tick, which drives the process; the position at its end is what the drive reports. */
double fsw_plant_drive_advance(fsw_plant_drive *d, double target) {
  if (fabs(target - d->setpoint) < d->band) target = d->setpoint;
  if (d->dead_ticks > 0) {
    const double arriving = d->on_the_way[0];
    memmove(d->on_the_way, d->on_the_way + 1, (size_t)(d->dead_ticks - 1) * sizeof(double));
    d->on_the_way[d->dead_ticks - 1] = target;
    target = arriving;
  }
  const double change = target - d->setpoint;
  if (change >= -d->largest_step && change <= d->largest_step) d->setpoint = target;
  else d->setpoint += change > 0.0 ? d->largest_step : -d->largest_step;
  const double behind = d->position - d->setpoint;
  d->position = d->setpoint + behind * d->left;
  return d->setpoint + behind * d->mean;
}

/* Between two ticks the process's temperature is a straight line: the lag is solved exactly. */
void fsw_plant_probe_advance(fsw_plant_probe *p, double process_c) {
  const double held_c = p->around_c, change_c = process_c - p->process_c;
  p->value_c = held_c + p->left * (p->value_c - held_c) + (1.0 - p->mean) * change_c;
  p->process_c = process_c;
  p->around_c = held_c + change_c;
}

/* The samples are exact, n' = a n + sqrt(1 - a^2) e with e standard normal; the first is stationary. */
double fsw_plant_sensor_read(fsw_plant_sensor *s, double normal, double value) {
  if (s->kept > 0.0 && s->has_noise)
    normal = s->kept * s->noise + sqrt(1.0 - s->kept * s->kept) * normal;
  s->noise = normal;
  s->has_noise = 1;
  value += s->deviation * normal;
  return s->resolution > 0.0 ? rint(value / s->resolution) * s->resolution : value;
}

void fsw_plant_outputs_of(const fsw_plant_model *m, const double *x, double force_kn,
                          double speed_rpm, fsw_plant_outputs *y) {
  const double *arg[] = {x, &force_kn, &speed_rpm, m->numbers};
  double *res[] = {&y->depth_mm,          &y->temperature_c,      &y->copper_temperature_c, &y->motor_torque_nm,
                   &y->process_torque_nm, &y->friction_torque_nm, &y->power_kw};
  process_outputs(arg, res);
}

/* Copper h times as hard under a force F is nominal copper under F / h with all stresses times h:
 * shear yield and contact pressure scale alike in (19)-(22). Friction beyond that scales the torque. */
static void outputs_in_copper(fsw_plant *p, const fsw_plant_model *m, double force_kn, double speed_rpm) {
  fsw_plant_machine *g = &p->machine;
  fsw_plant_outputs_of(m, p->x, force_kn / (1.0 + g->harder_here), speed_rpm, &p->outputs);
  g->nominal_nm = p->outputs.process_torque_nm;
  p->outputs.process_torque_nm *= 1.0 + g->torque_more;
}

/* Hardness where the tool is: harmonics of the circumference, so that the overlap meets the same copper. */
static void meet_copper(fsw_plant_machine *g, double friction) {
  double wave = 0.0;
  for (int k = 0; k < FSW_PLANT_WAVES; k++)
    if (g->wave[k] != 0.0)
      wave += g->wave[k] * sin(2.0 * PI * (k + 1) * g->travel_mm / g->circumference_mm + g->phase[k]);
  g->harder_here = (1.0 + g->harder) * (1.0 + wave) - 1.0;
  g->torque_more = (1.0 + g->harder_here) * (1.0 + friction) - 1.0;
}

/* Growth follows the heat through a lag; spindle and tool move on. */
static void machine_advance(fsw_plant_machine *g, double power_kw, double speed_rpm) {
  const double tool_mm = g->tool_mm_per_kw * power_kw, canister_mm = g->canister_mm_per_kw * power_kw;
  g->tool_mm = tool_mm + g->tool_left * (g->tool_mm - tool_mm);
  g->canister_mm = canister_mm + g->canister_left * (g->canister_mm - canister_mm);
  g->turns += speed_rpm / 60.0 * STEP_S;
  g->turns -= floor(g->turns);
  g->travel_mm += g->traverse_mm_per_s * STEP_S;
}

/* What a sensor shows beside the depth. */
static double shown_beside(const fsw_plant *p, const fsw_plant_mount *s, double depth_mm) {
  const fsw_plant_machine *g = &p->machine;
  const double swollen_mm = g->swelling_mm_per_mm * fmax(depth_mm - g->swelling_from_mm, 0.0);
  const double edge = s->edge_here * (g->travel_mm >= g->edge_at_mm) +
                      s->edge_ahead * (g->travel_mm + s->lead_mm >= g->edge_at_mm);
  return s->deflection * g->compliance_mm_per_kn * (p->acting[FORCE] - g->touch_off_kn) +
         s->tool * g->tool_mm + s->canister * g->canister_mm + s->swelling * swollen_mm + edge * g->edge_mm +
         s->runout * g->runout_mm * sin(2.0 * PI * g->turns);
}

/* Equilibrium at a power. The tool's torque (19)-(22) does not depend on the speed, so it gives the
 * speed that makes this power (24); friction (23) then follows from the speed, and both together are
 * the motor's torque (18) at rest. Each pass below adds one of these to the outputs. */
void fsw_plant_begin(fsw_plant *p, const fsw_plant_model *m, const double *x, double power_kw) {
  fsw_plant_machine *g = &p->machine;
  fsw_plant_outputs *y = &p->outputs;
  memcpy(p->x, x, sizeof p->x);
  memset(p->power, 0, sizeof p->power);
  for (int k = 0; k < m->delay_steps; k++) p->power[k][0] = power_kw - m->power_kw;
  p->oldest = p->stopped = 0;
  p->inertia_nm = 0.0;
  g->travel_mm = g->turns = g->tool_mm = g->canister_mm = 0.0;
  meet_copper(g, 0.0);
  double inputs[2] = {m->force_kn * (1.0 + g->harder_here), 0.0};
  outputs_in_copper(p, m, inputs[FORCE], inputs[SPEED]);
  inputs[SPEED] = power_kw * 30000.0 / (PI * y->process_torque_nm);
  outputs_in_copper(p, m, inputs[FORCE], inputs[SPEED]);
  p->x[MOTOR] = y->process_torque_nm + y->friction_torque_nm;
  outputs_in_copper(p, m, inputs[FORCE], inputs[SPEED]);
  for (int i = 0; i < 2; i++) {
    fsw_plant_drive *d = &p->drive[i];
    p->acting[i] = d->position = d->setpoint = inputs[i];
    for (int k = 0; k < FSW_PLANT_DEAD_TICKS; k++) d->on_the_way[k] = inputs[i];
  }
  for (int i = 0; i < FSW_PLANT_SENSORS; i++) p->sensor[i].has_noise = 0;
  p->probe.value_c = p->probe.process_c = p->probe.around_c = y->temperature_c;
}

/* Inverts (16) and (27) at rest: the rise of the temperature gives the power, and the softening that
 * goes with it the depth of nominal copper. */
int fsw_plant_start(fsw_plant *p, const fsw_plant_model *m, double depth_mm, double temperature_c) {
  const double rise_c = temperature_c - m->temperature_c;
  const double power_kw = m->power_kw + rise_c / m->gain_c_per_kw;
  const double softening = 1.0 + m->softening_per_c * rise_c;
  const double x[FSW_PLANT_STATES] = {depth_mm / softening - m->depth_mm, 0.0, 0.0, rise_c, rise_c};
  if (!(depth_mm > 0.0 && softening > 0.0 && power_kw > 0.0)) return 1;
  fsw_plant_begin(p, m, x, power_kw);
  return 0;
}

/* Another length of the dead time. Ages count from the newest power; where the longer queue has no
 * past of its own, the oldest known power repeats, as if it had been held before. */
void fsw_plant_refit(fsw_plant *p, int before, int after) {
  double kept[FSW_PLANT_DELAY][FSW_PLANT_POWER];
  for (int k = 0; k < after; k++) {
    const int age = after - 1 - k < before ? after - 1 - k : before - 1;
    memcpy(kept[k], p->power[(p->oldest + before - 1 - age) % before], sizeof kept[k]);
  }
  memcpy(p->power, kept, (size_t)after * sizeof kept[0]);
  p->oldest = 0;
  if (p->field) resize(p->field->copper, before + 1, after + 1, p->field->copper[0]);
}

void fsw_plant_show(fsw_plant *p, const fsw_plant_disturbance *d, double *shown) {
  p->probe.around_c = p->outputs.temperature_c + d->temperature_c;
  shown[DEPTH] = p->outputs.depth_mm + d->depth_mm;
  shown[TORQUE] = p->outputs.motor_torque_nm + p->inertia_nm -
                  p->torque_drop_nm_per_rpm * (p->acting[SPEED] - p->nominal_rpm);
  shown[TEMPERATURE] = p->probe.is_slow ? p->probe.value_c : p->probe.around_c;
}

void fsw_plant_measure(fsw_plant *p, const fsw_plant_disturbance *d, const double *normal,
                       double *shown) {
  double ideal[FSW_PLANT_QUANTITIES];
  fsw_plant_show(p, d, ideal);
  for (int i = 0; i < p->sensors; i++) {
    fsw_plant_sensor *s = &p->sensor[i];
    const double beside = s->quantity == DEPTH ? shown_beside(p, &s->mount, ideal[DEPTH]) : 0.0;
    shown[i] = fsw_plant_sensor_read(s, normal[i], ideal[s->quantity] + beside);
  }
}

static void move(fsw_plant *p, const double *command, const fsw_plant_disturbance *d,
                 fsw_plant_inputs *u) {
  const double added[2] = {d->force_kn, d->speed_rpm};
  fsw_plant_machine *g = &p->machine;
  for (int i = 0; i < 2; i++) {
    u->mean[i] = fsw_plant_drive_advance(&p->drive[i], command[i]) + added[i];
    u->end[i] = p->drive[i].position + added[i];
  }
  meet_copper(g, d->friction);
  u->copper_kn = u->mean[FORCE] / (1.0 + g->harder_here);
  u->added_nm = d->torque_nm + g->torque_more * g->nominal_nm; /* held during the tick */
}

int fsw_plant_leave(fsw_plant *p, double depth_mm, const fsw_plant_inputs *u) {
  p->left[0] = depth_mm;
  memcpy(p->left + 1, u->mean, sizeof u->mean);
  return FSW_PLANT_LEFT;
}

/* One step of the paper's process with an added torque; not 0 if it leaves the model: nothing is changed then.
 * The ring of powers is the dead time of (16): the oldest one heats now, and the power made in this
 * step takes its place. A power is kept as functions of time within its step, so that the delayed
 * heat is exact also where the dead time is not a whole number of steps. */
static int advance(fsw_plant *p, const fsw_plant_model *m, const fsw_plant_inputs *u) {
  double x[FSW_PLANT_STATES], power[FSW_PLANT_POWER], depth_mm, mean_kw, warm[3], *temperatures = warm;
  const int newer = (p->oldest + 1) % m->delay_steps;
  const double *past[] = {p->x, p->power[p->oldest], p->power[newer], m->numbers};
  const double *arg[] = {p->x, warm, &u->copper_kn, &u->mean[SPEED], m->numbers};
  double *res[] = {x, power, &depth_mm, &mean_kw};
  process_heat(past, &temperatures);
  process_step(arg, res);
  if (!(depth_mm > 0.0 && isfinite(power[0]))) return fsw_plant_leave(p, depth_mm, u); /* NaN, too */
  /* what is added rises within the step as 1 - exp(-s / lag), the first and the last function */
  const double more_kw = u->added_nm * u->mean[SPEED] * KW_PER_NM_RPM;
  x[MOTOR] += m->motor_risen * u->added_nm;
  power[0] += more_kw;
  power[FSW_PLANT_POWER - 1] -= more_kw;
  memcpy(p->x, x, sizeof x);
  memcpy(p->power[p->oldest], power, sizeof power);
  p->oldest = newer;
  return 0;
}

/* What the step leaves behind: outputs, growth of the machine, and the torque J dw/dt that the motor
 * needs to accelerate the spindle (the peaks of the paper's Fig. 5; no heat comes of it). */
static void settle(fsw_plant *p, const fsw_plant_model *m, const fsw_plant_inputs *u) {
  outputs_in_copper(p, m, u->end[FORCE], u->end[SPEED]);
  machine_advance(&p->machine, p->outputs.power_kw, u->mean[SPEED]);
  p->inertia_nm = m->inertia_nm_s_per_rpm * ((u->end[SPEED] - p->acting[SPEED]) / STEP_S);
  memcpy(p->acting, u->end, sizeof p->acting);
}

int fsw_plant_step(fsw_plant *p, const fsw_plant_model *m, const double *command,
                   const fsw_plant_disturbance *d) {
  fsw_plant_inputs inputs;
  move(p, command, d, &inputs);
  if (!p->stopped) p->stopped = (p->field ? fsw_plant_canister_advance : advance)(p, m, &inputs);
  if (!p->stopped) settle(p, m, &inputs);
  fsw_plant_probe_advance(&p->probe, p->outputs.temperature_c);
  return p->stopped;
}

void fsw_plant_measure_all(fsw_plant *plants, int n, const fsw_plant_disturbance *d,
                           const double *normals, double *shown) {
  for (int i = 0; i < n; i++)
    fsw_plant_measure(&plants[i], &d[i], normals + plants->sensors * i, shown + plants->sensors * i);
}

void fsw_plant_step_all(fsw_plant *plants, int n, const fsw_plant_model *m, const double *commands,
                        const fsw_plant_disturbance *d) {
  for (int i = 0; i < n; i++) fsw_plant_step(&plants[i], m, commands + 2 * i, &d[i]);
}
