/* The heat in a canister (fsw_plant/process.py), and the process on it instead of (16). */
#include "fsw_plant.h"

#include <math.h>
#include <string.h>

#include "equations.h"
#include "plant.h"

/* terms of the exponential's series, for a norm below 1/2 */
#define TERMS 16

/* out = a b; a has so many rows, b is square */
static void multiply(double *out, const double *a, int rows, const double *b, int n) {
  memset(out, 0, (size_t)(rows * n) * sizeof(double));
  for (int i = 0; i < rows; i++)
    for (int k = 0; k < n; k++)
      for (int j = 0; j < n; j++) out[i * n + j] += a[i * n + k] * b[k * n + j];
}

/* The transposed matrix of the heat's equations; returns its largest column sum. In the tool's frame
 * the traverse turns even amplitudes about the tool into odd ones and back (docs/concepts/canister.md).
 * This part is antisymmetric: turning moves heat but neither adds nor takes any. */
static double matrix(const fsw_plant_canister *c, double traverse_mm_per_s, double *a) {
  const int n = c->states, even = c->even;
  const double turning = traverse_mm_per_s / c->radius_mm;
  double norm = 0.0;
  for (int i = 0; i < n; i++) {
    double sum = 0.0;
    for (int j = 0; j < n; j++) {
      double *one = &a[j * n + i];
      *one = -c->decay[i * n + j];
      if (i < even && j >= even) *one -= turning * c->transport[i * (n - even) + j - even];
      if (i >= even && j < even) *one += turning * c->transport[j * (n - even) + i - even];
      sum += fabs(*one);
    }
    norm = fmax(norm, sum);
  }
  return norm;
}

/* Exponential of a step and its integral: series over a part of the step, which is then doubled.
 * Scaling and squaring (Moler and Van Loan 2003): for a norm up to 1/2 the first term left out is below
 * 1e-19 of the whole. Exponential K and integral R double by K(2t) = K(t)^2, R(2t) = R(t) + R(t) K(t). */
void fsw_plant_canister_over(const fsw_plant_canister *c, double traverse_mm_per_s, double dt_s,
                             double *kept, double *response, double *work) {
  const int n = c->states, even = c->even, size = n * n;
  double *a = work, *term = a + size, *next = term + size, part_s = dt_s;
  const double norm = matrix(c, traverse_mm_per_s, a);
  int doublings = 0;
  for (; norm * part_s > 0.5; doublings++) part_s *= 0.5;
  memset(term, 0, (size_t)size * sizeof *term);
  memset(kept, 0, (size_t)size * sizeof *kept);
  memset(response, 0, (size_t)(even * n) * sizeof *response);
  for (int i = 0; i < n; i++) term[i * n + i] = kept[i * n + i] = 1.0;
  for (int i = 0; i < even; i++) response[i * n + i] = part_s;
  for (int k = 1; k <= TERMS; k++) {
    multiply(next, term, n, a, n);
    for (int i = 0; i < size; i++) kept[i] += term[i] = next[i] * (part_s / k);
    for (int i = 0; i < even * n; i++) response[i] += term[i] * (part_s / (k + 1));
  }
  for (; doublings > 0; doublings--) {
    multiply(next, response, even, kept, n);
    for (int i = 0; i < even * n; i++) response[i] += next[i];
    multiply(next, kept, n, kept, n);
    memcpy(kept, next, (size_t)size * sizeof *kept);
  }
}

/* Weights of four positions for cubic interpolation between them; returns the first one. */
static int weigh(const fsw_plant_canister *c, double axial_mm, double *weight) {
  const double at = (axial_mm - c->axial_mm[0]) / (c->axial_mm[1] - c->axial_mm[0]);
  const int before = (int)at - 1, last = c->positions - 4;
  const int first = before < 0 ? 0 : before > last ? last : before;
  const double x = at - first;
  weight[0] = (1 - x) * (x - 2) * (x - 3) / 6;
  weight[1] = x * (x - 2) * (x - 3) / 2;
  weight[2] = -x * (x - 1) * (x - 3) / 2;
  weight[3] = x * (x - 1) * (x - 2) / 6;
  return first;
}

/* Exact for a power and a place that are held over the step: what is kept of the field, and the
 * response to the heat source where the tool stands. */
void fsw_plant_canister_step(const fsw_plant_canister *c, const double *kept, const double *response,
                             double power_kw, double axial_mm, double *amplitude) {
  const int n = c->states;
  double weight[4], next[FSW_PLANT_AMPLITUDES] = {0.0};
  const double *source = c->source + weigh(c, axial_mm, weight) * c->even;
  for (int j = 0; j < n; j++)
    for (int i = 0; i < n; i++) next[i] += kept[j * n + i] * amplitude[j];
  for (int j = 0; j < c->even; j++) {
    double heat = 0.0;
    for (int k = 0; k < 4; k++) heat += weight[k] * source[k * c->even + j];
    for (int i = 0; i < n; i++) next[i] += response[j * n + i] * (power_kw * heat);
  }
  memcpy(amplitude, next, (size_t)n * sizeof *next);
}

/* The field is linear in Kirchhoff's transform theta of the temperature, which takes up that hot copper
 * conducts less; the table leads back. rest is what settles at once and is in no amplitude. */
double fsw_plant_canister_stir_zone_c(const fsw_plant_canister *c, const double *amplitude,
                                      double power_kw, double axial_mm) {
  double weight[4], theta = 0.0;
  const int first = weigh(c, axial_mm, weight);
  for (int k = 0; k < 4; k++) {
    theta += weight[k] * c->rest[first + k] * power_kw;
    for (int j = 0; j < c->even; j++) theta += weight[k] * c->rim[(first + k) * c->even + j] * amplitude[j];
  }
  int low = 0, high = c->temperatures - 1; /* straight between the table's values */
  if (!(theta > c->theta_k[low])) return c->grid_c[low];
  if (!(theta < c->theta_k[high])) return c->grid_c[high];
  while (high - low > 1) {
    const int middle = (low + high) / 2;
    if (c->theta_k[middle] > theta) high = middle; else low = middle;
  }
  const double share = (theta - c->theta_k[low]) / (c->theta_k[high] - c->theta_k[low]);
  return c->grid_c[low] + share * (c->grid_c[high] - c->grid_c[low]);
}

/* A tick of the heat; 1 if the tool is off the copper: nothing is changed then. The exponential costs
 * far more than a step and is kept while the traverse speed stays. */
static int heat(fsw_plant_field *f, const fsw_plant_model *m, double power_kw, double traverse_mm_per_s) {
  const fsw_plant_canister *c = f->canister;
  if (!(f->axial_mm >= c->lowest_mm - 1e-9 && f->axial_mm <= c->highest_mm + 1e-9)) return 1;
  if (!f->is_ready || traverse_mm_per_s != f->traverse_mm_per_s)
    fsw_plant_canister_over(c, traverse_mm_per_s, STEP_S, f->kept, f->response, f->work);
  f->is_ready = 1, f->traverse_mm_per_s = traverse_mm_per_s;
  fsw_plant_canister_step(c, f->kept, f->response, power_kw, f->axial_mm, f->amplitude);
  memmove(f->copper, f->copper + 1, (size_t)m->delay_steps * sizeof *f->copper);
  f->copper[m->delay_steps] =
      fsw_plant_canister_stir_zone_c(c, f->amplitude, power_kw, f->axial_mm) - m->temperature_c;
  return 0;
}

void fsw_plant_meet(const fsw_plant_field *f, const fsw_plant_model *m, double *met) {
  const double *past = f->copper, part = m->delay_steps - m->dead_steps;
  met[0] = past[0] + part * (past[1] - past[0]);
  met[1] = past[1] + part * (past[m->delay_steps > 1 ? 2 : 1] - past[1]);
}

/* The step of all but the copper */
static void driven(const fsw_plant_field *f, const fsw_plant_model *m, const double *x, double force_kn,
                   double speed_rpm, double *next, double *mean_kw, double *depth_mm) {
  double met[2], power[FSW_PLANT_POWER], warm[3], *temperatures = warm;
  const double *past[] = {x, met, m->numbers};
  const double *arg[] = {x, warm, &force_kn, &speed_rpm, m->numbers};
  double *res[] = {next, power, depth_mm, mean_kw};
  fsw_plant_meet(f, m, met);
  process_met(past, &temperatures);
  process_step(arg, res);
}

int fsw_plant_canister_advance(fsw_plant *p, const fsw_plant_model *m, const fsw_plant_inputs *u) {
  double x[FSW_PLANT_STATES], mean_kw, depth_mm;
  driven(p->field, m, p->x, u->copper_kn, u->mean[1], x, &mean_kw, &depth_mm);
  mean_kw += m->motor_mean * u->added_nm * u->mean[1] * KW_PER_NM_RPM;
  x[MOTOR] += m->motor_risen * u->added_nm;
  if (!(depth_mm > 0.0 && isfinite(mean_kw))) return fsw_plant_leave(p, depth_mm, u);
  if (heat(p->field, m, fmax(mean_kw, 0.0), p->machine.traverse_mm_per_s)) return FSW_PLANT_OFF_COPPER;
  x[COPPER] = p->field->copper[m->delay_steps];
  memcpy(p->x, x, sizeof x);
  return 0;
}

/* Heats from ambient until the thermocouple shows the start's temperature, then begins there. Copper
 * and tool are not in equilibrium then, as in a weld that has just begun. */
int fsw_plant_heat_up(fsw_plant *p, const fsw_plant_model *m, double depth_mm, double temperature_c,
                      double power_kw) {
  fsw_plant_field *f = p->field;
  const double rise_c = temperature_c - m->temperature_c, softening = 1.0 + m->softening_per_c * rise_c;
  double x[FSW_PLANT_STATES] = {depth_mm / softening - m->depth_mm}, next[FSW_PLANT_STATES], mean_kw, reached_mm;
  if (!(depth_mm > 0.0 && softening > 0.0)) return FSW_PLANT_LEFT;
  memset(f->amplitude, 0, (size_t)f->canister->states * sizeof *f->amplitude);
  x[TOOL] = fsw_plant_canister_stir_zone_c(f->canister, f->amplitude, 0.0, f->axial_mm) - m->temperature_c;
  for (int k = 0; k <= m->delay_steps; k++) f->copper[k] = x[TOOL];
  for (int k = 0; x[TOOL] < rise_c; k++) {
    p->left[0] = rise_c - x[TOOL];
    if (k * STEP_S >= FSW_PLANT_LONGEST_S) return FSW_PLANT_COLD;
    x[COPPER] = f->copper[m->delay_steps];
    driven(f, m, x, m->force_kn, 0.0, next, &mean_kw, &reached_mm);
    if (heat(f, m, power_kw, p->machine.traverse_mm_per_s)) return FSW_PLANT_OFF_COPPER;
    x[TOOL] = next[TOOL];
  }
  x[0] = depth_mm / (1.0 + m->softening_per_c * x[TOOL]) - m->depth_mm;
  x[COPPER] = f->copper[m->delay_steps];
  fsw_plant_begin(p, m, x, power_kw);
  return 0;
}
