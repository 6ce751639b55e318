#include "fsw_plant.h"

#include <math.h>
#include <string.h>

#include "equations.h"

#define STEP_S 0.1
#define PI 3.14159265358979323846
#define KW_PER_NM_RPM (PI / 30000.0)

enum { FORCE, SPEED };
enum { MOTOR = 5 };

#ifndef FSW_PLANT_ID
#define FSW_PLANT_ID "unknown"
#endif
const char *fsw_plant_id(void) { return FSW_PLANT_ID; }

/* What a first-order lag leaves of a deviation after a tick, and its mean over the tick. */
static double lag_left(double lag_s) { return lag_s > 0.0 ? exp(-STEP_S / lag_s) : 0.0; }
static double lag_mean(double lag_s) { return lag_s / STEP_S * (1.0 - lag_left(lag_s)); }

void fsw_plant_drive_configure(fsw_plant_drive *d, double largest_step, double lag_s,
                               int dead_ticks) {
  const int more = dead_ticks - d->dead_ticks;
  if (more > 0) memmove(d->on_the_way + more, d->on_the_way, (size_t)d->dead_ticks * sizeof(double));
  else memmove(d->on_the_way, d->on_the_way - more, (size_t)dead_ticks * sizeof(double));
  for (int k = 0; k < more; k++) d->on_the_way[k] = d->setpoint;
  d->dead_ticks = dead_ticks;
  d->largest_step = largest_step;
  d->left = lag_left(lag_s), d->mean = lag_mean(lag_s);
}

void fsw_plant_probe_configure(fsw_plant_probe *p, double lag_s) {
  p->left = lag_left(lag_s), p->mean = lag_mean(lag_s);
  p->is_slow = lag_s > 0.0;
}

void fsw_plant_sensor_configure(fsw_plant_sensor *s, double deviation, double resolution,
                                double correlation_s) {
  s->deviation = deviation, s->resolution = resolution, s->kept = lag_left(correlation_s);
}

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

void fsw_plant_begin(fsw_plant *p, const fsw_plant_model *m, const double *x, double power_kw) {
  fsw_plant_outputs *y = &p->outputs;
  double inputs[2] = {m->force_kn, 0.0};
  memcpy(p->x, x, sizeof p->x);
  memset(p->power, 0, sizeof p->power);
  for (int k = 0; k < m->delay_steps; k++) p->power[k][0] = power_kw - m->power_kw;
  p->oldest = p->stopped = 0;
  p->inertia_nm = 0.0;
  fsw_plant_outputs_of(m, p->x, inputs[FORCE], inputs[SPEED], y);
  inputs[SPEED] = power_kw * 30000.0 / (PI * y->process_torque_nm);
  fsw_plant_outputs_of(m, p->x, inputs[FORCE], inputs[SPEED], y);
  p->x[MOTOR] = y->process_torque_nm + y->friction_torque_nm;
  fsw_plant_outputs_of(m, p->x, inputs[FORCE], inputs[SPEED], y);
  for (int i = 0; i < 2; i++) {
    fsw_plant_drive *d = &p->drive[i];
    p->acting[i] = d->position = d->setpoint = inputs[i];
    for (int k = 0; k < FSW_PLANT_DEAD_TICKS; k++) d->on_the_way[k] = inputs[i];
  }
  for (int i = 0; i < 3; i++) p->sensor[i].has_noise = 0;
  p->probe.value_c = p->probe.process_c = p->probe.around_c = y->temperature_c;
}

int fsw_plant_start(fsw_plant *p, const fsw_plant_model *m, double depth_mm, double temperature_c) {
  const double rise_c = temperature_c - m->temperature_c;
  const double power_kw = m->power_kw + rise_c / m->gain_c_per_kw;
  const double softening = 1.0 + m->softening_per_c * rise_c;
  const double x[FSW_PLANT_STATES] = {depth_mm / softening - m->depth_mm, 0.0, 0.0, rise_c, rise_c};
  if (!(depth_mm > 0.0 && softening > 0.0 && power_kw > 0.0)) return 1;
  fsw_plant_begin(p, m, x, power_kw);
  return 0;
}

void fsw_plant_refit(fsw_plant *p, int before, int after) {
  double kept[FSW_PLANT_DELAY][FSW_PLANT_POWER];
  for (int k = 0; k < after; k++) {
    const int age = after - 1 - k < before ? after - 1 - k : before - 1;
    memcpy(kept[k], p->power[(p->oldest + before - 1 - age) % before], sizeof kept[k]);
  }
  memcpy(p->power, kept, (size_t)after * sizeof kept[0]);
  p->oldest = 0;
}

void fsw_plant_show(fsw_plant *p, const fsw_plant_disturbance *d, double *shown) {
  p->probe.around_c = p->outputs.temperature_c + d->temperature_c;
  shown[0] = p->outputs.depth_mm + d->depth_mm;
  shown[1] = p->outputs.motor_torque_nm + p->inertia_nm -
             p->torque_drop_nm_per_rpm * (p->acting[SPEED] - p->nominal_rpm);
  shown[2] = p->probe.is_slow ? p->probe.value_c : p->probe.around_c;
}

void fsw_plant_measure(fsw_plant *p, const fsw_plant_disturbance *d, const double *normal,
                       double *shown) {
  fsw_plant_show(p, d, shown);
  for (int i = 0; i < 3; i++) shown[i] = fsw_plant_sensor_read(&p->sensor[i], normal[i], shown[i]);
}

void fsw_plant_move(fsw_plant *p, const double *command, const fsw_plant_disturbance *d,
                    fsw_plant_inputs *u) {
  const double added[2] = {d->force_kn, d->speed_rpm};
  for (int i = 0; i < 2; i++) {
    u->mean[i] = fsw_plant_drive_advance(&p->drive[i], command[i]) + added[i];
    u->end[i] = p->drive[i].position + added[i];
  }
}

/* One step of the paper's process with an added torque; 1 if it leaves the model: nothing is changed then. */
static int advance(fsw_plant *p, const fsw_plant_model *m, const fsw_plant_inputs *u, double added_nm) {
  double x[FSW_PLANT_STATES], power[FSW_PLANT_POWER], depth_mm;
  const int newer = (p->oldest + 1) % m->delay_steps;
  const double *arg[] = {p->x,        p->power[p->oldest], p->power[newer], &u->mean[FORCE],
                         &u->mean[SPEED], m->numbers};
  double *res[] = {x, power, &depth_mm};
  process_step(arg, res);
  if (!(depth_mm > 0.0 && isfinite(power[0]))) { /* so that NaN fails too */
    p->left[0] = depth_mm;
    memcpy(p->left + 1, u->mean, sizeof u->mean);
    return 1;
  }
  /* what is added rises within the step as 1 - exp(-s / lag), the first and the last function */
  const double more_kw = added_nm * u->mean[SPEED] * KW_PER_NM_RPM;
  x[MOTOR] += m->motor_risen * added_nm;
  power[0] += more_kw;
  power[FSW_PLANT_POWER - 1] -= more_kw;
  memcpy(p->x, x, sizeof x);
  memcpy(p->power[p->oldest], power, sizeof power);
  p->oldest = newer;
  return 0;
}

void fsw_plant_settle(fsw_plant *p, const fsw_plant_model *m, const fsw_plant_inputs *u) {
  fsw_plant_outputs_of(m, p->x, u->end[FORCE], u->end[SPEED], &p->outputs);
  p->inertia_nm = m->inertia_nm_s_per_rpm * ((u->end[SPEED] - p->acting[SPEED]) / STEP_S);
  memcpy(p->acting, u->end, sizeof p->acting);
}

void fsw_plant_heat(fsw_plant *p) { fsw_plant_probe_advance(&p->probe, p->outputs.temperature_c); }

int fsw_plant_step(fsw_plant *p, const fsw_plant_model *m, const double *command,
                   const fsw_plant_disturbance *d) {
  fsw_plant_inputs inputs;
  fsw_plant_move(p, command, d, &inputs);
  if (!p->stopped) p->stopped = advance(p, m, &inputs, d->torque_nm);
  if (!p->stopped) fsw_plant_settle(p, m, &inputs);
  fsw_plant_heat(p);
  return p->stopped;
}

void fsw_plant_measure_all(fsw_plant *plants, int n, const fsw_plant_disturbance *d,
                           const double *normals, double *shown) {
  for (int i = 0; i < n; i++) fsw_plant_measure(&plants[i], &d[i], normals + 3 * i, shown + 3 * i);
}

void fsw_plant_step_all(fsw_plant *plants, int n, const fsw_plant_model *m, const double *commands,
                        const fsw_plant_disturbance *d) {
  for (int i = 0; i < n; i++) fsw_plant_step(&plants[i], m, commands + 2 * i, &d[i]);
}
