/* Memory of the plant; on a canister also that of the heat. */
#ifndef FMU_UNIT_H
#define FMU_UNIT_H

#include "fsw_plant.h"
#include "process.h"

typedef struct {
  fsw_plant plant;
#ifdef CANISTER_STATES
  fsw_plant_field field;
  double amplitude[CANISTER_STATES], kept[CANISTER_STATES * CANISTER_STATES];
  double response[CANISTER_EVEN * CANISTER_STATES], work[3 * CANISTER_STATES * CANISTER_STATES];
#endif
} fmu_unit;

#endif
