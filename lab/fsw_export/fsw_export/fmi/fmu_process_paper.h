/* Memory of the paper's process. */
#ifndef FMU_PROCESS_H
#define FMU_PROCESS_H

#include "process.h"

typedef struct {
  double x[PROCESS_STATES];
  double power[PROCESS_DELAY][PROCESS_POWER]; /* power on its way through the dead time, oldest first */
} fmu_process;

#endif
