/* Memory of the plant. */
#ifndef FMU_UNIT_H
#define FMU_UNIT_H

#include "process.h"

typedef struct {
  double x[PROCESS_STATES];
  double power[PROCESS_DELAY][PROCESS_POWER]; /* power on its way through the dead time, oldest first */
  double setpoint[2], position[2];            /* of the drives: force, speed */
} fmu_unit;

#endif
