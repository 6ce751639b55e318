/* Memory of the plant, and what it asks of its process. */
#ifndef FMU_UNIT_H
#define FMU_UNIT_H

#include "fmu_process.h"

typedef struct {
  fmu_process process;
  double setpoint[2], position[2]; /* of the drives: force, speed */
  double probe_c;                  /* temperature of the thermocouple's probe */
  double process_c, disturbance_k; /* around it at the last tick */
} fmu_unit;

#endif
