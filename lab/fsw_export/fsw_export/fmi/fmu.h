/* An FMU is the functions of FMI 2.0 (fmu.c) about a unit: fmu_plant.c, or fmu_controller.c with tune.h. The unit's memory
 * is the struct fmu_unit (fmu_unit.h), its variables are the structs of variables.h, which is generated. */
#ifndef FMU_H
#define FMU_H

#define FMU_MESSAGE 300                      /* longest message, with its end */

#include "variables.h"

/* Start again from the parameters. Returns 0, or 1 with a message of one line if that fails. */
int fmu_start(fmu_unit *unit, fmu_reals *real, fmu_integers *integer, fmu_booleans *boolean, char *message);

/* One step of FMU_STEP_S: from parameters, inputs and memory to outputs and memory. Returns 0; 1 with a message when it is
 * not possible: nothing is changed then. */
int fmu_step(fmu_unit *unit, fmu_reals *real, fmu_integers *integer, fmu_booleans *boolean, char *message);

/* Set pointers in the memory, which has been copied from another instance, perhaps of another process. */
void fmu_relink(fmu_unit *unit);

#endif
