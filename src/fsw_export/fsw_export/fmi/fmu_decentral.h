/* Memory of the decentralized controller, and the functions of its library. */
#ifndef FMU_DECENTRAL_H
#define FMU_DECENTRAL_H

#include "fsw_decentral_tables.h"

#define CONTROLLER_INIT fsw_decentral_init
#define CONTROLLER_CONFIGURE fsw_decentral_configure
#define CONTROLLER_RESET fsw_decentral_reset
#define CONTROLLER_STEP fsw_decentral_step
#define CONTROLLER_NEEDS "each minimum must be below its maximum, integral and tracking times above 0"
#define CONTROLLER_RELINK(c) ((void)(c)) /* has no pointers */

typedef fsw_decentral_tuning controller_tuning;
typedef fsw_decentral_input controller_input;
typedef fsw_decentral_output controller_output;

typedef struct {
  fsw_decentral controller;
  double applied[2]; /* force, speed */
} fmu_unit;

#endif
