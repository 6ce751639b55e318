/* The plant as an FMU: that of fsw_plant (plant.c), without noise, faults and watchdog. */
#include <math.h>
#include <stdio.h>

#include "fmu.h"
#include "fmu_unit.h"

#ifdef CANISTER_STATES
#include "canister.h"
#endif

enum { FORCE, SPEED };

static const fsw_plant_model MODEL = PLANT_MODEL;

static double clip(double value, double low, double high) { return value < low ? low : value > high ? high : value; }

/* The settings, which may change at any step */
static void configure(fsw_plant *p, const fmu_reals *v) {
  const double lag_s = v->actuators_lag_s;
  fsw_plant_drive_configure(&p->drive[FORCE], v->limits_force_rate_kn_per_s * FMU_STEP_S, lag_s, 0);
  fsw_plant_drive_configure(&p->drive[SPEED], v->limits_speed_rate_rpm_per_s * FMU_STEP_S, lag_s, 0);
  fsw_plant_probe_configure(&p->probe, v->sensors_temperature_lag_s);
  p->torque_drop_nm_per_rpm = v->sensors_torque_drop_nm_per_rpm;
  p->nominal_rpm = NOMINAL_SPEED_RPM;
}

static fsw_plant_disturbance disturbance(const fmu_reals *v) {
  const fsw_plant_disturbance d = {v->depth_disturbance_mm, v->temperature_disturbance_k, 0.0,
                                   v->axial_force_disturbance_kn, v->spindle_speed_disturbance_rpm, 0.0};
  return d;
}

/* What the instance shows at the end of a step */
static void show(fsw_plant *p, fmu_reals *v) {
  const fsw_plant_disturbance added = disturbance(v);
  double shown[FSW_PLANT_QUANTITIES];
  fsw_plant_show(p, &added, shown);
  v->depth_mm = shown[0];
  v->torque_nm = shown[1];
  v->temperature_c = shown[2];
  v->acting_force_kn = p->acting[FORCE];
  v->acting_speed_rpm = p->acting[SPEED];
  v->process_torque_nm = p->outputs.process_torque_nm;
  v->friction_torque_nm = p->outputs.friction_torque_nm;
  v->power_kw = p->outputs.power_kw;
  v->copper_temperature_c = p->outputs.copper_temperature_c;
}

static int limits_are_wrong(const fmu_reals *v, char *message) {
  if (v->limits_force_min_kn < v->limits_force_max_kn && v->limits_speed_min_rpm < v->limits_speed_max_rpm) return 0;
  snprintf(message, FMU_MESSAGE, "limits: force %g to %g kN, speed %g to %g rpm; minimum must be below maximum",
           v->limits_force_min_kn, v->limits_force_max_kn, v->limits_speed_min_rpm, v->limits_speed_max_rpm);
  return 1;
}

#ifdef CANISTER_STATES
static void off_copper(const fmu_reals *v, char *message) {
  snprintf(message, FMU_MESSAGE, "canister: tool at %g mm is off the copper; %g to %g mm above the joint", v->axial_mm,
           CANISTER.lowest_mm, CANISTER.highest_mm);
}

/* The tool during the next step */
static int move(fsw_plant *p, const fmu_reals *v, char *message) {
  p->machine.traverse_mm_per_s = v->traverse_mm_per_min / 60.0;
  p->field->axial_mm = v->axial_mm;
  if (v->traverse_mm_per_min >= 0.0 && isfinite(v->traverse_mm_per_min)) return 0;
  snprintf(message, FMU_MESSAGE, "input traverse_mm_per_min is %g; the tool travels one way: at least 0",
           v->traverse_mm_per_min);
  return 1;
}
#endif

/* The process at the depth and temperature of the start */
static int start(fmu_unit *u, const fmu_reals *v, char *message) {
#ifdef CANISTER_STATES
  fmu_relink(u);
  if (move(&u->plant, v, message)) return 1;
  const int why = fsw_plant_heat_up(&u->plant, &MODEL, v->start_depth_mm, v->start_temperature_c, v->start_power_kw);
  if (why == FSW_PLANT_LEFT)
    snprintf(message, FMU_MESSAGE, "no start at depth %.4g mm, %.4g degC (27)", v->start_depth_mm, v->start_temperature_c);
  if (why == FSW_PLANT_COLD)
    snprintf(message, FMU_MESSAGE, "start at %g degC: %g kW leave %.1f degC missing after %d s of heating; raise "
             "start.power_kw", v->start_temperature_c, v->start_power_kw, u->plant.left[0], FSW_PLANT_LONGEST_S);
  if (why == FSW_PLANT_OFF_COPPER) off_copper(v, message);
  return why;
#else
  if (fsw_plant_start(&u->plant, &MODEL, v->start_depth_mm, v->start_temperature_c)) {
    snprintf(message, FMU_MESSAGE, "start: no equilibrium at %.4g mm, %.4g degC: depth, power and the correction factor (27) "
             "must be positive", v->start_depth_mm, v->start_temperature_c);
    return 1;
  }
#endif
  return 0;
}

int fmu_start(fmu_unit *u, fmu_reals *v, fmu_integers *integer, fmu_booleans *boolean, char *message) {
  (void)integer, (void)boolean;
  if (limits_are_wrong(v, message)) return 1;
  configure(&u->plant, v);
  if (start(u, v, message)) return 1;
  const double force = u->plant.acting[FORCE], speed = u->plant.acting[SPEED];
  if (!(force >= v->limits_force_min_kn && force <= v->limits_force_max_kn && speed >= v->limits_speed_min_rpm &&
        speed <= v->limits_speed_max_rpm)) {
    snprintf(message, FMU_MESSAGE, "start: %g mm, %g degC needs %.2f kN and %.1f rpm, beyond the drives' limits",
             v->start_depth_mm, v->start_temperature_c, force, speed);
    return 1;
  }
  show(&u->plant, v);
  return 0;
}

/* One step of a plant; the heat in a canister changes only if it is possible */
static int advance(fsw_plant *p, const fmu_reals *v, const double *command, char *message) {
  const fsw_plant_disturbance added = disturbance(v);
  const int why = fsw_plant_step(p, &MODEL, command, &added);
  if (why == FSW_PLANT_LEFT)
    snprintf(message, FMU_MESSAGE, "process model: depth %.4g mm with %.4g kN, %.4g rpm; the model holds while the shoulder "
             "is in the copper, above 0 mm", p->left[0], p->left[1], p->left[2]);
#ifdef CANISTER_STATES
  if (why == FSW_PLANT_OFF_COPPER) off_copper(v, message);
#endif
  return why;
}

int fmu_step(fmu_unit *u, fmu_reals *v, fmu_integers *integer, fmu_booleans *boolean, char *message) {
  (void)integer, (void)boolean;
  const double *given[] = {&v->force_kn, &v->speed_rpm, &v->axial_force_disturbance_kn, &v->spindle_speed_disturbance_rpm,
                           &v->depth_disturbance_mm, &v->temperature_disturbance_k};
  static const char *const names[] = {"force_kn", "speed_rpm", "axial_force_disturbance_kn",
                                      "spindle_speed_disturbance_rpm", "depth_disturbance_mm", "temperature_disturbance_k"};
  for (int i = 0; i < 6; i++)
    if (!isfinite(*given[i])) {
      snprintf(message, FMU_MESSAGE, "input %s is not a finite number", names[i]);
      return 1;
    }
  if (limits_are_wrong(v, message)) return 1;
  fsw_plant next = u->plant;
  const double command[2] = {clip(v->force_kn, v->limits_force_min_kn, v->limits_force_max_kn),
                             clip(v->speed_rpm, v->limits_speed_min_rpm, v->limits_speed_max_rpm)};
  configure(&next, v);
#ifdef CANISTER_STATES
  if (move(&next, v, message)) return 1;
#endif
  if (advance(&next, v, command, message)) return 1;
  u->plant = next;
  show(&u->plant, v);
  return 0;
}

void fmu_relink(fmu_unit *u) {
#ifdef CANISTER_STATES
  fsw_plant_field *f = u->plant.field = &u->field;
  f->canister = &CANISTER, f->amplitude = u->amplitude, f->kept = u->kept, f->response = u->response, f->work = u->work;
#else
  (void)u;
#endif
}
