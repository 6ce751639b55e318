#include "fsw_plant.h"

#include <math.h>
#include <string.h>

#include "equations.h"

#define STEP_S 0.1
#define KW_PER_NM_RPM (3.14159265358979323846 / 30000.0)

enum { FORCE, SPEED };
enum { MOTOR = 5 };

#ifndef FSW_PLANT_ID
#define FSW_PLANT_ID "unknown"
#endif
const char *fsw_plant_id(void) { return FSW_PLANT_ID; }

double fsw_plant_drive_advance(fsw_plant_drive *d, double target) {
  if (fabs(target - d->setpoint) < d->band) target = d->setpoint;
  if (d->dead_ticks > 0) {
    const double arriving = d->on_the_way[0];
    memmove(d->on_the_way, d->on_the_way + 1, (d->dead_ticks - 1) * sizeof(double));
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

void fsw_plant_drive_delay(fsw_plant_drive *d, int dead_ticks) {
  const int more = dead_ticks - d->dead_ticks;
  if (more > 0) memmove(d->on_the_way + more, d->on_the_way, d->dead_ticks * sizeof(double));
  else memmove(d->on_the_way, d->on_the_way - more, dead_ticks * sizeof(double));
  for (int k = 0; k < more; k++) d->on_the_way[k] = d->setpoint;
  d->dead_ticks = dead_ticks;
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

void fsw_plant_begin(fsw_plant *p, const fsw_plant_model *m, const double *x, double power_kw,
                     const double *inputs) {
  memcpy(p->x, x, sizeof p->x);
  memset(p->power, 0, sizeof p->power);
  for (int k = 0; k < m->delay_steps; k++) p->power[k][0] = power_kw;
  p->oldest = p->stopped = 0;
  p->inertia_nm = 0.0;
  for (int i = 0; i < 2; i++) {
    fsw_plant_drive *d = &p->drive[i];
    p->acting[i] = d->position = d->setpoint = inputs[i];
    for (int k = 0; k < FSW_PLANT_DEAD_TICKS; k++) d->on_the_way[k] = inputs[i];
  }
  for (int i = 0; i < 3; i++) p->sensor[i].has_noise = 0;
  fsw_plant_outputs_of(m, x, inputs[FORCE], inputs[SPEED], &p->outputs);
  p->probe.value_c = p->probe.process_c = p->probe.around_c = p->outputs.temperature_c;
}

void fsw_plant_refit(fsw_plant *p, int before, int after) {
  double kept[FSW_PLANT_DELAY][FSW_PLANT_POWER];
  for (int k = 0; k < after; k++) {
    const int age = after - 1 - k < before ? after - 1 - k : before - 1;
    memcpy(kept[k], p->power[(p->oldest + before - 1 - age) % before], sizeof kept[k]);
  }
  memcpy(p->power, kept, after * sizeof kept[0]);
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
