/* The paper's process in the plant, as ProcessModel in fsw_model/process.py. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "fmu.h"
#include "fmu_plant.h"

/* Equilibrium at the depth and temperature of the start, as ProcessModel.equilibrium */
int process_start(fmu_process *p, const fmu_reals *v, double *power_kw, char *message) {
  const double depth = v->start_depth_mm, rise = v->start_temperature_c - PROCESS_TEMPERATURE_C;
  const double power = PROCESS_POWER_KW + rise / PROCESS_GAIN_C_PER_KW, softening = 1.0 + PROCESS_SOFTENING_PER_C * rise;
  if (!(depth > 0.0 && power > 0.0 && softening > 0.0)) {
    snprintf(message, FMU_MESSAGE,
             "start: no equilibrium at %.4g mm, %.4g degC: needs %.4g kW and a correction factor (27) of %.4g; all but the "
             "temperature must be positive", depth, v->start_temperature_c, power, softening);
    return 1;
  }
  const double x[PROCESS_STATES] = {depth / softening - PROCESS_DEPTH_MM, 0.0, 0.0, rise, rise, 0.0};
  memcpy(p->x, x, sizeof x);
  for (int k = 0; k < PROCESS_DELAY; k++) {
    p->power[k][0] = power - PROCESS_POWER_KW;
    for (int i = 1; i < PROCESS_POWER; i++) p->power[k][i] = 0.0;
  }
  *power_kw = power;
  return 0;
}

int process_advance(fmu_process *p, const fmu_reals *v, double force_kn, double speed_rpm, char *message) {
  double power[PROCESS_POWER], x[PROCESS_STATES], depth;
  (void)v;
  const double *arg[PROCESS_STEP_ARG] = {p->x, p->power[0], p->power[PROCESS_DELAY > 1], &force_kn, &speed_rpm};
  double *res[PROCESS_STEP_RES] = {x, power, &depth};
  int iw[PROCESS_STEP_IW + 1];
  double w[PROCESS_STEP_W + 1];
  process_step(arg, res, iw, w, 0);
  if (process_left(depth, power[0], force_kn, speed_rpm, message)) return 1;
  memcpy(p->x, x, sizeof x);
  memmove(p->power[0], p->power[1], sizeof p->power - sizeof p->power[0]);
  memcpy(p->power[PROCESS_DELAY - 1], power, sizeof power);
  return 0;
}
