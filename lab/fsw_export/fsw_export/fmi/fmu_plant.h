/* What the plant asks of its process on a canister (fmu_canister.c), in the place of the paper's. */
#ifndef FMU_PLANT_H
#define FMU_PLANT_H

#include "fmu.h"
#include "fmu_unit.h"

/* Where the process starts, but for the motor torque. Returns 0; 1 with a message when there is no such start. */
int canister_start(fmu_unit *u, const fmu_reals *v, double *x, char *message);

/* One step with force and speed held. Returns 0; 1 with a message when the model does not hold: nothing is used then. */
int canister_advance(fmu_unit *u, const fmu_reals *v, const double *inputs, char *message);

/* A message about a step that ended outside the model; returns 1. */
int process_left(double depth_mm, double force_kn, double speed_rpm, char *message);

#endif
