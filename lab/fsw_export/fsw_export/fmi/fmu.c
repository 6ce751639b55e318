/* FMI 2.0 for co-simulation about a unit (fmu.h), with a fixed step.
 *
 * No globals: everything that an instance remembers is its struct fmu_state, so that state and serialized state are copies
 * of it. Errors are logged in one line each, whether debug logging is on or not. */
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"
#include "fmu.h"

/* difference of times that counts as rounding */
#define SAME_S (1e-3 * FMU_STEP_S)

enum { OUTPUT, INPUT, FIXED, TUNABLE }; /* kinds of variables */
typedef struct {
  const char *name;
  int kind;
  double min, max; /* of a parameter */
} variable_info;

#include "tables.h"

enum { INSTANTIATED, INITIALIZING, RUNNING, TERMINATED };

typedef struct {
  int phase;
  double start_s, steps; /* the time is start_s + steps * FMU_STEP_S */
  fmu_reals real;
  fmu_integers integer;
  fmu_booleans boolean;
  fmu_unit unit;
} fmu_state;

typedef struct {
  const fmi2CallbackFunctions *callbacks;
  char *name;
  fmu_state state;
} fmu;

/* where the variables of a type are */
#define AT(member) (offsetof(fmu, state) + offsetof(fmu_state, member))
/* serialized: the guid of the sources, the size of the state, a checksum of all the rest, then the state */
#define SIZE_AT (sizeof FMU_GUID)
#define CHECKSUM_AT (SIZE_AT + sizeof(uint64_t))
#define STATE_AT (CHECKSUM_AT + sizeof(uint32_t))
#define SERIALIZED (STATE_AT + sizeof(fmu_state))

static fmi2Status refuse(const fmu *f, const char *message) {
  if (f->callbacks->logger)
    f->callbacks->logger(f->callbacks->componentEnvironment, f->name, fmi2Error, "logStatusError", message);
  return fmi2Error;
}

static double now_s(const fmu *f) { return f->state.start_s + f->state.steps * FMU_STEP_S; }

static void reset(fmu *f) {
  memset(&f->state, 0, sizeof f->state);
  f->state.phase = INSTANTIATED;
  f->state.real = REAL_START;
  f->state.integer = INTEGER_START;
  f->state.boolean = BOOLEAN_START;
}

static fmi2Status start(fmu *f) {
  char message[FMU_MESSAGE];
  fmu_state *s = &f->state;
  return fmu_start(&s->unit, &s->real, &s->integer, &s->boolean, message) ? refuse(f, message) : fmi2OK;
}

/* Inquire and create */

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[]) {
  (void)on, (void)n, (void)categories; /* only errors are logged, and always */
  return c ? fmi2OK : fmi2Error;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging) {
  fmu *f;
  (void)resources, (void)visible, (void)logging;
  if (!callbacks || !name || !(f = calloc(1, sizeof *f))) return NULL;
  f->callbacks = callbacks;
  f->name = malloc(strlen(name) + 1);
  if (f->name) strcpy(f->name, name);
  if (!f->name || !*name)
    refuse(f, "fmi2Instantiate: the instance needs a name");
  else if (type != fmi2CoSimulation)
    refuse(f, "fmi2Instantiate: this FMU is for co-simulation only");
  else if (!guid || strcmp(guid, FMU_GUID) != 0)
    refuse(f, "fmi2Instantiate: the guid is not that of this binary (" FMU_GUID "): modelDescription.xml is of another FMU");
  else {
    reset(f);
    return f;
  }
  fmi2FreeInstance(f);
  return NULL;
}

void fmi2FreeInstance(fmi2Component c) {
  if (c) free(((fmu *)c)->name);
  free(c);
}

/* Initialize, terminate, reset */

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start_s,
                               fmi2Boolean has_stop, fmi2Real stop_s) {
  fmu *f = c;
  (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop_s;
  if (!f) return fmi2Error;
  if (f->state.phase != INSTANTIATED) return refuse(f, "fmi2SetupExperiment: must come before the initialization");
  f->state.start_s = start_s;
  return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
  fmu *f = c;
  if (!f) return fmi2Error;
  if (f->state.phase != INSTANTIATED) return refuse(f, "fmi2EnterInitializationMode: is initialized already; use fmi2Reset");
  f->state.phase = INITIALIZING;
  return start(f);
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
  fmu *f = c;
  fmi2Status status;
  if (!f) return fmi2Error;
  if (f->state.phase != INITIALIZING)
    return refuse(f, "fmi2ExitInitializationMode: fmi2EnterInitializationMode must come before");
  status = start(f);
  if (status == fmi2OK) f->state.phase = RUNNING;
  return status;
}

fmi2Status fmi2Terminate(fmi2Component c) {
  if (!c) return fmi2Error;
  ((fmu *)c)->state.phase = TERMINATED;
  return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c) {
  if (!c) return fmi2Error;
  reset(c);
  return fmi2OK;
}

/* Variables: those of a type are one struct of members of this type, in the order of their value references. */

static fmi2Status get(fmu *f, size_t at, size_t size, size_t count, const fmi2ValueReference vr[], size_t n, void *values) {
  if (!f) return fmi2Error;
  if (f->state.phase == INITIALIZING && start(f) != fmi2OK) return fmi2Error; /* inputs or parameters may have been set */
  for (size_t i = 0; i < n; i++) {
    if (vr[i] >= count) return refuse(f, "fmi2Get...: there is no variable with this type and value reference");
    memcpy((char *)values + i * size, (const char *)f + at + vr[i] * size, size);
  }
  return fmi2OK;
}

/* Whether a variable may be set now, to this value. */
static fmi2Status check(const fmu *f, const variable_info *info, size_t count, fmi2ValueReference vr, double value) {
  char message[FMU_MESSAGE];
  const char *problem = "";
  if (vr >= count) return refuse(f, "fmi2Set...: there is no variable with this type and value reference");
  info += vr;
  if (info->kind == OUTPUT)
    problem = "is an output";
  else if (f->state.phase == TERMINATED)
    problem = "cannot be set after fmi2Terminate";
  else if (info->kind == FIXED && f->state.phase == RUNNING)
    problem = "is a fixed parameter: set it before the end of the initialization";
  else if (info->kind == INPUT || (value >= info->min && value <= info->max))
    return fmi2OK;
  if (*problem)
    snprintf(message, sizeof message, "%s %s", info->name, problem);
  else
    snprintf(message, sizeof message, "%s = %g is outside %g to %g", info->name, value, info->min, info->max);
  return refuse(f, message);
}

static fmi2Status set_integers(fmu *f, size_t at, const variable_info *info, size_t count, const fmi2ValueReference vr[],
                               size_t n, const int values[]) {
  if (!f) return fmi2Error;
  for (size_t i = 0; i < n; i++) {
    if (check(f, info, count, vr[i], values[i]) != fmi2OK) return fmi2Error;
    memcpy((char *)f + at + vr[i] * sizeof(int), &values[i], sizeof(int));
  }
  return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real values[]) {
  return get(c, AT(real), sizeof(double), N_REALS, vr, n, values);
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Integer values[]) {
  return get(c, AT(integer), sizeof(int), N_INTEGERS, vr, n, values);
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Boolean values[]) {
  return get(c, AT(boolean), sizeof(int), N_BOOLEANS, vr, n, values);
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real values[]) {
  fmu *f = c;
  if (!f) return fmi2Error;
  for (size_t i = 0; i < n; i++) {
    if (check(f, REAL_INFO, N_REALS, vr[i], values[i]) != fmi2OK) return fmi2Error;
    memcpy((char *)f + AT(real) + vr[i] * sizeof(double), &values[i], sizeof(double));
  }
  return fmi2OK;
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer values[]) {
  return set_integers(c, AT(integer), INTEGER_INFO, N_INTEGERS, vr, n, values);
}

fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Boolean values[]) {
  return set_integers(c, AT(boolean), BOOLEAN_INFO, N_BOOLEANS, vr, n, values);
}

static fmi2Status no_strings(const fmu *f, size_t n) {
  if (!f) return fmi2Error;
  return n ? refuse(f, "there is no variable of type String") : fmi2OK;
}

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2String values[]) {
  (void)vr, (void)values;
  return no_strings(c, n);
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2String values[]) {
  (void)vr, (void)values;
  return no_strings(c, n);
}

/* State */

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
  if (!c || !state) return fmi2Error;
  if (!*state) *state = malloc(sizeof(fmu_state));
  if (!*state) return refuse(c, "fmi2GetFMUstate: no memory");
  memcpy(*state, &((fmu *)c)->state, sizeof(fmu_state));
  return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
  fmu *f = c;
  if (!f) return fmi2Error;
  if (!state) return refuse(f, "fmi2SetFMUstate: there is no state");
  memcpy(&f->state, state, sizeof(fmu_state));
  fmu_relink(&f->state.unit);
  return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
  if (!c) return fmi2Error;
  if (state) {
    free(*state);
    *state = NULL;
  }
  return fmi2OK;
}

/* CRC-32 of IEEE 802.3 without a table: finds every damage of up to 32 bits in a row. */
static uint32_t crc32(uint32_t crc, const fmi2Byte bytes[], size_t size) {
  size_t n;
  int bit;
  for (n = 0; n < size; n++) {
    crc ^= (unsigned char)bytes[n];
    for (bit = 0; bit < 8; bit++) crc = (crc >> 1) ^ (crc & 1 ? 0xEDB88320u : 0u);
  }
  return crc;
}

static uint32_t checksum(const fmi2Byte bytes[]) {
  return ~crc32(crc32(0xFFFFFFFFu, bytes, CHECKSUM_AT), bytes + STATE_AT, sizeof(fmu_state));
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) {
  if (!c || !state || !size) return fmi2Error;
  *size = SERIALIZED;
  return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
  const uint64_t state_size = sizeof(fmu_state);
  uint32_t sum;
  if (!c || !state || !bytes) return fmi2Error;
  if (size < SERIALIZED) return refuse(c, "fmi2SerializeFMUstate: not enough room, see fmi2SerializedFMUstateSize");
  memcpy(bytes, FMU_GUID, sizeof FMU_GUID);
  memcpy(bytes + SIZE_AT, &state_size, sizeof state_size);
  memcpy(bytes + STATE_AT, state, sizeof(fmu_state));
  sum = checksum(bytes);
  memcpy(bytes + CHECKSUM_AT, &sum, sizeof sum);
  return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
  uint64_t state_size;
  uint32_t sum;
  if (!c || !state || !bytes) return fmi2Error;
  if (size < STATE_AT || memcmp(bytes, FMU_GUID, sizeof FMU_GUID) != 0)
    return refuse(c, "fmi2DeSerializeFMUstate: this is no state of this FMU (" FMU_GUID ")");
  memcpy(&state_size, bytes + SIZE_AT, sizeof state_size);
  if (size != SERIALIZED || state_size != sizeof(fmu_state))
    return refuse(c, "fmi2DeSerializeFMUstate: the state is cut, or of a binary for another platform");
  memcpy(&sum, bytes + CHECKSUM_AT, sizeof sum);
  if (sum != checksum(bytes)) return refuse(c, "fmi2DeSerializeFMUstate: the state is damaged, its checksum is wrong");
  if (!*state) *state = malloc(sizeof(fmu_state));
  if (!*state) return refuse(c, "fmi2DeSerializeFMUstate: no memory");
  memcpy(*state, bytes + STATE_AT, sizeof(fmu_state));
  return fmi2OK;
}

/* Steps */

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real from_s, fmi2Real step_s, fmi2Boolean no_way_back) {
  fmu *f = c;
  fmu_state *s;
  char message[FMU_MESSAGE];
  (void)no_way_back;
  if (!f) return fmi2Error;
  s = &f->state;
  if (s->phase != RUNNING) return refuse(f, "fmi2DoStep: not initialized, or terminated");
  if (!(fabs(from_s - now_s(f)) <= SAME_S)) {
    snprintf(message, sizeof message, "fmi2DoStep from %.10g s, but the time is %.10g s: %s", from_s, now_s(f),
             from_s < now_s(f) ? "to go back use fmi2SetFMUstate" : "no step can be left out");
    return refuse(f, message);
  }
  if (!(fabs(step_s - FMU_STEP_S) <= SAME_S)) {
    snprintf(message, sizeof message, "fmi2DoStep over %.10g s: the communication step must be %g s", step_s, FMU_STEP_S);
    return refuse(f, message);
  }
  if (fmu_step(&s->unit, &s->real, &s->integer, &s->boolean, message)) return refuse(f, message);
  s->steps += 1.0;
  return fmi2OK;
}

fmi2Status fmi2CancelStep(fmi2Component c) { return c ? refuse(c, "fmi2CancelStep: a step is never pending") : fmi2Error; }

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value) {
  (void)kind, (void)value;
  return c ? fmi2Discard : fmi2Error;
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) {
  if (!c || kind != fmi2LastSuccessfulTime) return c ? fmi2Discard : fmi2Error;
  *value = now_s(c);
  return fmi2OK;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value) {
  (void)kind, (void)value;
  return c ? fmi2Discard : fmi2Error;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value) {
  if (!c || kind != fmi2Terminated) return c ? fmi2Discard : fmi2Error;
  *value = fmi2False;
  return fmi2OK;
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value) {
  (void)kind, (void)value;
  return c ? fmi2Discard : fmi2Error;
}

/* What modelDescription.xml says is not there */

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[],
                                       const fmi2Real values[]) {
  (void)vr, (void)n, (void)order, (void)values;
  return c ? refuse(c, "fmi2SetRealInputDerivatives: inputs are held during a step") : fmi2Error;
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[],
                                        fmi2Real values[]) {
  (void)vr, (void)n, (void)order, (void)values;
  return c ? refuse(c, "fmi2GetRealOutputDerivatives: not provided") : fmi2Error;
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t n_unknown,
                                        const fmi2ValueReference known[], size_t n_known, const fmi2Real by[],
                                        fmi2Real values[]) {
  (void)unknown, (void)n_unknown, (void)known, (void)n_known, (void)by, (void)values;
  return c ? refuse(c, "fmi2GetDirectionalDerivative: not provided") : fmi2Error;
}
