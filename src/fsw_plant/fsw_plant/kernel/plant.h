/* What the plant's sources share. */
#ifndef FSW_PLANT_PARTS_H
#define FSW_PLANT_PARTS_H

#include "fsw_plant.h"

#define STEP_S 0.1
#define PI 3.14159265358979323846
#define KW_PER_NM_RPM (PI / 30000.0)

enum { COPPER = 3, TOOL = 4, MOTOR = 5 }; /* in the state x */

/* Notes where a step would have left the model, and returns FSW_PLANT_LEFT. */
int fsw_plant_leave(fsw_plant *plant, double depth_mm, const fsw_plant_inputs *inputs);

/* One step of the process on a canister; not 0 if it is not possible: nothing is changed then. */
int fsw_plant_canister_advance(fsw_plant *plant, const fsw_plant_model *model,
                               const fsw_plant_inputs *inputs);

#endif
