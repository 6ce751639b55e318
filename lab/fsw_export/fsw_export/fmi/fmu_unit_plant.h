/* Memory of the plant; on a canister also that of the heat. */
#ifndef FMU_UNIT_H
#define FMU_UNIT_H

#include "fsw_plant.h"
#include "process.h"

#ifdef CANISTER_STATES
#include "fmu_canister.h"
#endif

typedef struct {
  fsw_plant plant;
#ifdef CANISTER_STATES
  fmu_canister canister;
#endif
} fmu_unit;

#endif
