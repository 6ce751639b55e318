/* The process on a canister in the plant: as fsw_plant/canister_process.py, with the heat of fsw_plant/canister/compact.py. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "canister.h"
#include "fmu_plant.h"

enum { N = CANISTER_STATES, EVEN = CANISTER_EVEN, COPPER = 3, TOOL = 4, NEWEST = PROCESS_DELAY };

/* terms of the exponential's series, for a norm below 1/2 */
#define TERMS 16

typedef double matrix[N][N];

static void multiply(matrix out, const matrix a, const matrix b) {
  memset(out, 0, sizeof(matrix));
  for (int i = 0; i < N; i++)
    for (int k = 0; k < N; k++)
      for (int j = 0; j < N; j++) out[i][j] += a[i][k] * b[k][j];
}

/* Exponential of a step and its integral: series over a part of the step, which is then doubled */
static void prepare(fmu_canister *p, double traverse_mm_per_s) {
  matrix a, term = {{0.0}}, next, whole = {{0.0}}, integral = {{0.0}};
  const double turning = traverse_mm_per_s / CANISTER_RADIUS_MM;
  double norm = 0.0, part_s = FMU_STEP_S;
  int doublings = 0;
  for (int i = 0; i < N; i++) {
    double row = 0.0;
    for (int j = 0; j < N; j++) {
      a[i][j] = -CANISTER_DECAY[i * N + j];
      if (i < EVEN && j >= EVEN) a[i][j] -= turning * CANISTER_TRANSPORT[i * (N - EVEN) + j - EVEN];
      if (i >= EVEN && j < EVEN) a[i][j] += turning * CANISTER_TRANSPORT[j * (N - EVEN) + i - EVEN];
      row += fabs(a[i][j]);
    }
    norm = fmax(norm, row);
  }
  for (; norm * part_s > 0.5; doublings++) part_s *= 0.5;
  for (int i = 0; i < N; i++) term[i][i] = whole[i][i] = 1.0, integral[i][i] = part_s;
  for (int k = 1; k <= TERMS; k++) {
    multiply(next, term, a);
    for (int i = 0; i < N; i++)
      for (int j = 0; j < N; j++) {
        term[i][j] = next[i][j] * (part_s / k);
        whole[i][j] += term[i][j];
        integral[i][j] += term[i][j] * (part_s / (k + 1));
      }
  }
  for (; doublings > 0; doublings--) {
    multiply(next, whole, integral);
    for (int i = 0; i < N; i++)
      for (int j = 0; j < N; j++) integral[i][j] += next[i][j];
    multiply(next, whole, whole);
    memcpy(whole, next, sizeof whole);
  }
  memcpy(p->kept, whole, sizeof whole);
  for (int i = 0; i < N; i++) memcpy(p->response[i], integral[i], sizeof p->response[i]);
  p->traverse_mm_per_s = traverse_mm_per_s;
  p->ready = 1;
}

/* Temperature of theta, straight between the table's values */
static double temperature_c(double theta) {
  int low = 0, high = CANISTER_TEMPERATURES - 1;
  if (!(theta > CANISTER_THETA_K[low])) return CANISTER_GRID_C[low];
  if (!(theta < CANISTER_THETA_K[high])) return CANISTER_GRID_C[high];
  while (high - low > 1) {
    const int middle = (low + high) / 2;
    if (CANISTER_THETA_K[middle] > theta) high = middle; else low = middle;
  }
  const double share = (theta - CANISTER_THETA_K[low]) / (CANISTER_THETA_K[high] - CANISTER_THETA_K[low]);
  return CANISTER_GRID_C[low] + share * (CANISTER_GRID_C[high] - CANISTER_GRID_C[low]);
}

/* A step of the heat with its inputs held, and the stir zone at its end. Returns 0; 1 with a message. */
static int heat(fmu_canister *p, const fmu_reals *v, double power_kw, double *stir_zone_c, char *message) {
  const double at = (v->axial_mm - CANISTER_AXIAL_MM[0]) / (CANISTER_AXIAL_MM[1] - CANISTER_AXIAL_MM[0]);
  const double traverse_mm_per_s = v->traverse_mm_per_min / 60.0;
  if (!(v->axial_mm >= CANISTER_LOWEST_MM - 1e-9 && v->axial_mm <= CANISTER_HIGHEST_MM + 1e-9)) {
    snprintf(message, FMU_MESSAGE, "canister: tool at %g mm is off the copper; %g to %g mm above the joint", v->axial_mm,
             (double)CANISTER_LOWEST_MM, (double)CANISTER_HIGHEST_MM);
    return 1;
  }
  if (!(traverse_mm_per_s >= 0.0 && isfinite(traverse_mm_per_s))) {
    snprintf(message, FMU_MESSAGE, "input traverse_mm_per_min is %g; the tool travels one way: at least 0",
             v->traverse_mm_per_min);
    return 1;
  }
  if (!p->ready || traverse_mm_per_s != p->traverse_mm_per_s) prepare(p, traverse_mm_per_s);
  const int before = (int)at - 1, last = CANISTER_POSITIONS - 4;
  const int first = before < 0 ? 0 : before > last ? last : before;
  const double x = at - first;
  const double weight[4] = {(1 - x) * (x - 2) * (x - 3) / 6, x * (x - 2) * (x - 3) / 2, -x * (x - 1) * (x - 3) / 2,
                            x * (x - 1) * (x - 2) / 6};
  double source[EVEN] = {0.0}, rim[EVEN] = {0.0}, next[N] = {0.0}, theta = 0.0;
  for (int k = 0; k < 4; k++) {
    for (int j = 0; j < EVEN; j++) {
      source[j] += power_kw * weight[k] * CANISTER_SOURCE[(first + k) * EVEN + j];
      rim[j] += weight[k] * CANISTER_RIM[(first + k) * EVEN + j];
    }
    theta += power_kw * weight[k] * CANISTER_REST[first + k];
  }
  for (int i = 0; i < N; i++) {
    for (int j = 0; j < N; j++) next[i] += p->kept[i][j] * p->heat[j];
    for (int j = 0; j < EVEN; j++) next[i] += p->response[i][j] * source[j];
  }
  memcpy(p->heat, next, sizeof next);
  for (int j = 0; j < EVEN; j++) theta += rim[j] * next[j];
  *stir_zone_c = temperature_c(theta);
  return 0;
}

/* The step of all but the copper, which the tool meets as it was a dead time ago */
static void driven(const fmu_canister *p, const double *x, double force_kn, double speed_rpm, double *next, double *mean_kw,
                   double *depth_mm) {
  const double *past = p->copper, part = PROCESS_DELAY - PROCESS_DEAD_STEPS;
  const double met[2] = {past[0] + part * (past[1] - past[0]),
                         past[1] + part * (past[PROCESS_DELAY > 1 ? 2 : 1] - past[1])};
  const double *arg[DRIVEN_STEP_ARG] = {x, met, &force_kn, &speed_rpm};
  double *res[DRIVEN_STEP_RES] = {next, mean_kw, depth_mm};
  int iw[DRIVEN_STEP_IW + 1];
  double w[DRIVEN_STEP_W + 1];
  driven_step(arg, res, iw, w, 0);
}

static void append(fmu_canister *p, double stir_zone_c) {
  memmove(p->copper, p->copper + 1, sizeof p->copper - sizeof *p->copper);
  p->copper[NEWEST] = stir_zone_c - PROCESS_TEMPERATURE_C;
}

/* The canister heated from ambient by a constant power until the thermocouple shows the temperature of the start */
int canister_start(fmu_unit *u, const fmu_reals *v, double *x, char *message) {
  fmu_canister *p = &u->canister;
  const double depth = v->start_depth_mm, rise = v->start_temperature_c - PROCESS_TEMPERATURE_C;
  const double softening = 1.0 + PROCESS_SOFTENING_PER_C * rise;
  double next[PROCESS_STATES], mean, reached, stir_zone = temperature_c(0.0);
  if (!(depth > 0.0 && softening > 0.0)) {
    snprintf(message, FMU_MESSAGE, "no start at depth %.4g mm, %.4g degC (27)", depth, v->start_temperature_c);
    return 1;
  }
  memset(p->heat, 0, sizeof p->heat);
  memset(x, 0, PROCESS_STATES * sizeof *x);
  x[0] = depth / softening - PROCESS_DEPTH_MM;
  for (int k = 0; k <= PROCESS_DELAY; k++) p->copper[k] = stir_zone - PROCESS_TEMPERATURE_C;
  x[TOOL] = p->copper[NEWEST];
  for (long k = 0; x[TOOL] < rise; k++) {
    if (k * FMU_STEP_S >= CANISTER_LONGEST_S) {
      snprintf(message, FMU_MESSAGE, "start at %g degC: %g kW leave %.1f degC missing after %g s of heating; raise "
               "start.power_kw", v->start_temperature_c, v->start_power_kw, rise - x[TOOL], (double)CANISTER_LONGEST_S);
      return 1;
    }
    if (heat(p, v, v->start_power_kw, &stir_zone, message)) return 1;
    x[COPPER] = p->copper[NEWEST];
    driven(p, x, PROCESS_FORCE_KN, 0.0, next, &mean, &reached);
    x[TOOL] = next[TOOL];
    append(p, stir_zone);
  }
  x[0] = depth / (1.0 + PROCESS_SOFTENING_PER_C * x[TOOL]) - PROCESS_DEPTH_MM;
  x[COPPER] = p->copper[NEWEST];
  return 0;
}

int canister_advance(fmu_unit *u, const fmu_reals *v, const double *inputs, char *message) {
  fmu_canister *p = &u->canister;
  double x[PROCESS_STATES], mean_kw, depth, stir_zone;
  driven(p, u->plant.x, inputs[0], inputs[1], x, &mean_kw, &depth);
  if (!(depth > 0.0 && isfinite(mean_kw))) /* so that NaN fails too */
    return process_left(depth, inputs[0], inputs[1], message);
  if (heat(p, v, fmax(mean_kw, 0.0), &stir_zone, message)) return 1;
  append(p, stir_zone);
  x[COPPER] = p->copper[NEWEST];
  memcpy(u->plant.x, x, sizeof x);
  return 0;
}
