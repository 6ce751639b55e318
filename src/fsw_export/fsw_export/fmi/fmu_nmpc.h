/* Memory of the NMPC, and the functions of its library. */
#ifndef FMU_NMPC_H
#define FMU_NMPC_H

#include "fsw_nmpc_tables.h"

#define CONTROLLER_INIT(c, tuning) fsw_controller_init(c, &fsw_nmpc_model, tuning)
#define CONTROLLER_CONFIGURE fsw_controller_configure
#define CONTROLLER_RESET fsw_controller_reset
#define CONTROLLER_STEP fsw_controller_step
#define CONTROLLER_NEEDS "each minimum must be below its maximum"
#define CONTROLLER_RELINK(c) ((c)->model = fsw_nmpc_model) /* its tables */

typedef fsw_tuning controller_tuning;
typedef fsw_input controller_input;
typedef fsw_output controller_output;

typedef struct {
  fsw_controller controller;
  double applied[2]; /* force, speed */
} fmu_unit;

#endif
