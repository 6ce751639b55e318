/* What the plant asks of its process: the paper's (fmu_process_paper.c), or on a canister (fmu_process_canister.c). */
#ifndef FMU_PLANT_H
#define FMU_PLANT_H

#include "fmu.h"
#include "fmu_unit.h"

/* Where the process starts, but for the motor torque, and the power that the spindle gives there. Returns 0; 1 with a
 * message when there is no such start. */
int process_start(fmu_process *p, const fmu_reals *v, double *power_kw, char *message);

/* One step with force and speed held. Returns 0; 1 with a message when the model does not hold: nothing is used then. */
int process_advance(fmu_process *p, const fmu_reals *v, double force_kn, double speed_rpm, char *message);

/* Whether a step ended outside the model, as this depth and this power show; then with a message. */
int process_left(double depth_mm, double power_kw, double force_kn, double speed_rpm, char *message);

#endif
