/* What the FMU of a controller has besides fmu_controller.c. */
#ifndef FMU_CONTROLLER_H
#define FMU_CONTROLLER_H

#include "fmu.h"

/* The exported tuning with the FMU's parameters in place. Returns 0; 1 with a message when that is not possible. */
int controller_tune(controller_tuning *tuning, const fmu_reals *real, const fmu_integers *integer, char *message);

#endif
