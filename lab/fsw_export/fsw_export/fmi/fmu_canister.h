/* Memory of the process on a canister. */
#ifndef FMU_CANISTER_H
#define FMU_CANISTER_H

#include "process.h"

typedef struct {
  double copper[PROCESS_DELAY + 1]; /* stir zone less operating temperature: now and as far as the dead time, oldest first */
  double heat[CANISTER_STATES];
  /* a step at this traverse speed, once it is ready: what it keeps of the heat, and what it makes of a source */
  int ready;
  double traverse_mm_per_s, kept[CANISTER_STATES][CANISTER_STATES], response[CANISTER_STATES][CANISTER_EVEN];
} fmu_canister;

#endif
