/* The rows of the QP: built from a prediction, and multiplied by vectors.
 *
 * The states are eliminated (condensing), which suits a short horizon with few moves. Variables
 * are the moves divided by their largest value. Rows in use are the weighted outputs that moves
 * can affect; the moves themselves and the block-end inputs (sums of moves) need no matrix. */
#include <math.h>

#include "internal.h"

/* largest start (in scaled moves), inside the limits; smallest curvature of a move */
#define INSIDE 0.95
#define LEAST_CURVATURE 1e-9
/* Four partial sums let the compiler vectorise without changing the order of additions. */
double fsw_dot(const double *restrict a, const double *restrict b, int n) {
  double sum[4] = {0.0, 0.0, 0.0, 0.0};
  int j = 0;
  for (; j + 4 <= n; j += 4)
    for (int i = 0; i < 4; i++) sum[i] += a[j + i] * b[j + i];
  for (; j < n; j++) sum[0] += a[j] * b[j];
  return (sum[0] + sum[1]) + (sum[2] + sum[3]);
}

static int padded(int n) { return (n + FSW_PAD - 1) / FSW_PAD * FSW_PAD; }

/* Variables, their costs and limits. The inputs are bounded at the ends of the blocks only: within a
 * block they change by equal moves, so they are extreme at its ends. */
static void build_variables(const fsw_nmpc_model *m, const fsw_nmpc_tuning *t, const fsw_start *s, const double *v,
                            fsw_workspace *w) {
  const int nv = w->nv = 2 * m->n_blocks;
  double intervals[FSW_MAX_BLOCKS] = {0.0};
  const double now[2] = {s->force_kn, s->speed_rpm}, move_weight[2] = {t->move_force_per_kn, t->move_speed_per_rpm};
  for (int i = 0; i < m->n_out; i++) intervals[m->interval_block[i]] += 1.0;
  w->n_moves = 0;
  for (int j = 0; j < nv; j++) {
    const int q = j & 1;
    const double scale = fsw_reach(t, q) * m->block_reach[j >> 1], z = v[j] / scale;
    w->scale[j] = scale;
    w->size[j] = intervals[j >> 1] * scale;
    w->z[j] = fsw_clip(z, -INSIDE, INSIDE);
    const double square = t->full_move_cost / (fsw_reach(t, q) * fsw_reach(t, q));
    w->diagonal[j] = square * scale * w->size[j] / m->block_reach[j >> 1] + LEAST_CURVATURE;
    /* L1 cost of a move: weight |z| = 2 weight max(0, z) - weight z, one soft side, not two */
    const double weight = move_weight[q] * w->size[j];
    w->gradient[j] = -weight;
    if (weight > 0.0) w->move[w->n_moves++] = j;
    w->input_low[j] = fsw_least(t, q) - now[q];
    w->input_high[j] = fsw_most(t, q) - now[q];
  }
  for (int j = nv; j < padded(nv); j++) w->z[j] = w->step[j] = w->dual[j] = 0.0;
}

static double inverse_square(double scale) { return scale > 0.0 ? 1.0 / (scale * scale) : 0.0; }

/* The QP about the moves v, from a prediction along them: outputs and sensitivities of the nonlinear
 * model in, a linear model in scaled moves out. One such QP a tick is the Gauss-Newton step of the
 * real-time iteration (Diehl, Bock and Schloeder 2005). */
void fsw_build(const fsw_nmpc_model *m, const fsw_nmpc_tuning *t, const fsw_problem *problem, const double *v,
               fsw_workspace *w) {
  const int n_out = m->n_out;
  const double l1[2] = {t->weight_depth_per_mm, t->weight_temperature_per_c};
  const double square[2] = {inverse_square(t->depth_scale_mm), inverse_square(t->temperature_scale_c)};
  int n = 0;
  build_variables(m, t, &problem->start, v, w);
  w->n_depth = w->n_soft_rows = 0;
  for (int r = 0; r < 2 * n_out; r++) {
    const int q = r >= n_out, i = q ? r - n_out : r;
    const int width = q ? m->temperature_width[i] : m->depth_width[i];
    double *a = w->by[r], at_zero = w->output[r]; /* output of the linear model without moves */
    for (int j = 0; j < width; j++) {
      at_zero -= a[j] * v[j];
      a[j] *= w->scale[j];
    }
    for (int j = width; j < padded(w->nv); j++) a[j] = 0.0;
    w->output[r] = at_zero;
    if (width == 0 || !(l1[q] > 0.0 || square[q] > 0.0)) continue;
    w->row[n] = r;
    w->row_width[n] = width;
    w->low[n] = problem->low[q][i] - at_zero;
    w->high[n] = problem->high[q][i] - at_zero;
    w->square[n] = square[q] > 0.0 ? square[q] : 0.0;
    if (l1[q] > 0.0) w->soft_row[w->n_soft_rows++] = n;
    n++;
    if (!q) w->n_depth = n;
  }
  w->n_rows = n;
  const int k_rows = w->n_soft_rows;
  w->n_kept = k_rows ? w->soft_row[0] : n;
  for (int k = 0; k < k_rows; k++) w->soft.weight[k] = w->soft.weight[k_rows + k] = l1[w->soft_row[k] >= w->n_depth];
  for (int k = 0; k < w->n_moves; k++) w->soft.weight[2 * k_rows + k] = -2.0 * w->gradient[w->move[k]];
}

/* value[] = a'z of the rows in use from `first` on, input[] = change of the block-end inputs */
void fsw_row_products(const fsw_workspace *w, int first, const double *z, double *value, double *input) {
  for (int r = first; r < w->n_rows; r++) value[r] = fsw_dot(w->by[w->row[r]], z, (w->row_width[r] + 3) / 4 * 4);
  double sum[2] = {0.0, 0.0};
  for (int j = 0; j < w->nv; j++) {
    sum[j & 1] += w->size[j] * z[j];
    input[j] = sum[j & 1];
  }
}

/* out += sum over rows of a * row_force, which is 0 before `first`, plus the inputs' rows * input_force */
void fsw_add_transposed(const fsw_workspace *w, int first, const double *row_force, const double *input_force, double *restrict out) {
  int r = first / 4 * 4;
  for (; r + 4 <= w->n_rows; r += 4) {
    const double *restrict a0 = w->by[w->row[r]], *restrict a1 = w->by[w->row[r + 1]];
    const double *restrict a2 = w->by[w->row[r + 2]], *restrict a3 = w->by[w->row[r + 3]];
    const double f0 = row_force[r], f1 = row_force[r + 1], f2 = row_force[r + 2], f3 = row_force[r + 3];
    int width = w->row_width[r];
    for (int i = 1; i < 4; i++)
      if (w->row_width[r + i] > width) width = w->row_width[r + i];
    for (int j = 0; j < width; j++) out[j] += (f0 * a0[j] + f1 * a1[j]) + (f2 * a2[j] + f3 * a3[j]);
  }
  for (; r < w->n_rows; r++) {
    const double *restrict a = w->by[w->row[r]];
    for (int j = 0; j < w->row_width[r]; j++) out[j] += row_force[r] * a[j];
  }
  double sum[2] = {0.0, 0.0};
  for (int j = w->nv - 1; j >= 0; j--) {
    sum[j & 1] += input_force[j];
    out[j] += w->size[j] * sum[j & 1];
  }
}
