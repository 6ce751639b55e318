/* A controller as an FMU. Its library has init, configure, reset and step; which one it is the unit's header says. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "fmu.h"
#include "signals.h" /* generated: give_input, show_output */
#include "tune.h"    /* controller_tune: puts the FMU's parameters into the exported tuning; 1 with a message if it cannot */

static int refuse(char *message) {
  snprintf(message, FMU_MESSAGE, "parameters: cannot be used together; " CONTROLLER_NEEDS);
  return 1;
}

/* What is applied is held, inside the limits. */
static void hold(const fmu_unit *u, fmu_reals *real) {
  real->force_kn = fmin(fmax(u->applied[0], real->force_min), real->force_max);
  real->speed_rpm = fmin(fmax(u->applied[1], real->speed_min), real->speed_max);
}

int fmu_start(fmu_unit *u, fmu_reals *real, fmu_integers *integer, fmu_booleans *boolean, char *message) {
  controller_tuning tuning;
  if (controller_tune(&tuning, real, integer, message)) return 1;
  if (CONTROLLER_INIT(&u->controller, &tuning)) return refuse(message);
  CONTROLLER_RESET(&u->controller, real->start_force_kn, real->start_speed_rpm);
  u->applied[0] = real->start_force_kn;
  u->applied[1] = real->start_speed_rpm;
  hold(u, real);
  boolean->healthy = 0;
  return 0;
}

int fmu_step(fmu_unit *u, fmu_reals *real, fmu_integers *integer, fmu_booleans *boolean, char *message) {
  controller_tuning tuning;
  controller_input in;
  controller_output out;
  if (controller_tune(&tuning, real, integer, message)) return 1;
  if (memcmp(&tuning, &u->controller.tuning, sizeof tuning) != 0 && CONTROLLER_CONFIGURE(&u->controller, &tuning))
    return refuse(message);
  if (boolean->applied_valid && isfinite(real->applied_force_kn) && isfinite(real->applied_speed_rpm)) {
    u->applied[0] = real->applied_force_kn;
    u->applied[1] = real->applied_speed_rpm;
  }
  memset(&in, 0, sizeof in);
  give_input(&in, real, integer, boolean);
  in.applied_force_kn = u->applied[0];
  in.applied_speed_rpm = u->applied[1];
  in.dt_s = FMU_STEP_S;
  CONTROLLER_STEP(&u->controller, &in, &out);
  show_output(&out, real, integer, boolean);
  if (!out.healthy) hold(u, real);
  u->applied[0] = real->force_kn;
  u->applied[1] = real->speed_rpm;
  return 0;
}

void fmu_relink(fmu_unit *unit) {
  (void)unit;
  CONTROLLER_RELINK(&unit->controller);
}
