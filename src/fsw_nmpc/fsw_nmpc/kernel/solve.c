/* Condensed QP with L1 dead-band costs, solved by Mehrotra's predictor-corrector method.
 *
 * min  1/2 z'Hz + g'z + sum_r w_r (max(0, a_r'z - high_r) + max(0, low_r - a_r'z))   s.t.  |z_j| <= 1, input bounds
 *
 * in moves z scaled by their largest value. Every side of a soft row has a violation t >= 0 with dual pi and a slack
 * s >= 0 with dual lambda, lambda + pi = w; t, s and the duals are eliminated, so each iteration factors one dense
 * matrix of the size of z. A row's width says how many leading variables it depends on. */
#include <math.h>

#include "internal.h"

#define STEP_TO_BOUNDARY 0.995
#define RANK 4

/* Four partial sums, so that the compiler may vectorise without changing the order of additions. */
static double dot(const double *restrict a, const double *restrict b, int n) {
  double sum[4] = {0.0, 0.0, 0.0, 0.0};
  int j = 0;
  for (; j + 4 <= n; j += 4)
    for (int i = 0; i < 4; i++) sum[i] += a[j + i] * b[j + i];
  for (; j < n; j++) sum[0] += a[j] * b[j];
  return (sum[0] + sum[1]) + (sum[2] + sum[3]);
}

static const double *output_row(const fsw_nmpc_model *m, const fsw_workspace *w, int r, int *width) {
  if (r < m->n_out) {
    *width = m->depth_width[r];
    return w->by_depth[r];
  }
  *width = m->temp_width[r - m->n_out];
  return w->by_temp[r - m->n_out];
}

/* value[] = a'z of every soft row, hard_value[] = of every hard row */
static void row_products(const fsw_nmpc_model *m, const fsw_workspace *w, const double *z, double *value, double *hard) {
  const int nv = 2 * m->n_blocks, n_rows = 2 * m->n_out;
  for (int r = 0; r < n_rows; r++) {
    int width;
    const double *a = output_row(m, w, r, &width);
    value[r] = dot(a, z, width);
  }
  double sum[2] = {0.0, 0.0};
  for (int j = 0; j < nv; j++) {
    value[n_rows + j] = z[j];
    hard[j] = z[j];
    sum[j & 1] += w->size[j] * w->scale[j] * z[j];
    hard[nv + j] = sum[j & 1];
  }
}

/* out += sum over rows of a * soft_coefficient and a * hard_coefficient */
static void add_transposed(const fsw_nmpc_model *m, const fsw_workspace *w, const double *soft, const double *hard, double *out) {
  const int nv = 2 * m->n_blocks, n_rows = 2 * m->n_out;
  for (int r = 0; r < n_rows; r++) {
    int width;
    const double *a = output_row(m, w, r, &width);
    const double f = soft[r];
    for (int j = 0; j < width; j++) out[j] += f * a[j];
  }
  double sum[2] = {0.0, 0.0};
  for (int j = nv - 1; j >= 0; j--) {
    sum[j & 1] += hard[nv + j];
    out[j] += soft[n_rows + j] + hard[j] + w->size[j] * w->scale[j] * sum[j & 1];
  }
}

static void build(const fsw_nmpc_model *m, const fsw_nmpc_call *c, const double *v, fsw_workspace *w) {
  const int nv = 2 * m->n_blocks, n_out = m->n_out;
  for (int j = 0; j < nv; j++) {
    w->scale[j] = c->move_max[j & 1];
    w->size[j] = 0.0;
    w->gradient[j] = 0.0;
    for (int i = 0; i <= j; i++) w->hessian[j][i] = 0.0;
  }
  for (int i = 0; i < n_out; i++) {
    w->size[2 * m->interval_block[i]] += 1.0;
    w->size[2 * m->interval_block[i] + 1] += 1.0;
  }
  for (int j = 0; j < nv; j++) {
    const double limit = 0.95;
    const double z = v[j] / w->scale[j];
    w->z[j] = z > limit ? limit : (z < -limit ? -limit : z);
    w->hessian[j][j] = c->move_square[j & 1] * w->scale[j] * w->scale[j] * w->size[j] + 1e-9;
    w->low[2 * n_out + j] = w->high[2 * n_out + j] = 0.0;
    w->weight[2 * n_out + j] = c->move_weight[j & 1] * w->scale[j] * w->size[j];
  }
  for (int r = 0; r < 2 * n_out; r++) {
    int width;
    double *a = (double *)output_row(m, w, r, &width);
    const int is_temp = r >= n_out, i = is_temp ? r - n_out : r;
    double at_zero = is_temp ? w->temp[i] : w->depth[i]; /* the linear model's output without moves */
    for (int j = 0; j < width; j++) {
      at_zero -= a[j] * v[j];
      a[j] *= w->scale[j];
    }
    for (int j = width; j < nv; j++) a[j] = 0.0;
    if (is_temp) w->temp[i] = at_zero;
    else w->depth[i] = at_zero;
    w->low[r] = (is_temp ? c->temp_low[i] : c->depth_low[i]) - at_zero;
    w->high[r] = (is_temp ? c->temp_high[i] : c->depth_high[i]) - at_zero;
    w->weight[r] = width ? (is_temp ? c->temp_weight[i] : c->depth_weight[i]) : 0.0;
    const double q = is_temp ? c->temp_square[i] : c->depth_square[i];
    if (q <= 0.0) continue;
    const double centre = 0.5 * (w->low[r] + w->high[r]);
    for (int j = 0; j < width; j++) {
      const double qa = q * a[j];
      w->gradient[j] -= qa * centre;
      for (int l = 0; l <= j; l++) w->hessian[j][l] += qa * a[l];
    }
  }
  double reach[2] = {0.0, 0.0};
  const double now[2] = {c->force_kn, c->speed_rpm};
  for (int j = 0; j < nv; j++) {
    const int q = j & 1;
    w->hard_low[j] = -1.0;
    w->hard_high[j] = 1.0;
    reach[q] += 0.98 * w->size[j] * w->scale[j]; /* an input outside its bounds must come back as fast as it may */
    const double low = c->input_min[q] - now[q], high = c->input_max[q] - now[q];
    w->hard_low[nv + j] = low < reach[q] ? low : reach[q];
    w->hard_high[nv + j] = high > -reach[q] ? high : -reach[q];
  }
}

static void start(const fsw_nmpc_model *m, fsw_workspace *w, int n_soft, int n_hard) {
  row_products(m, w, w->z, w->value, w->hard_value);
  double cost = 0.0;
  for (int r = 0; r < n_soft; r++) {
    const double over = w->value[r] - w->high[r], under = w->low[r] - w->value[r];
    cost += w->weight[r] * ((over > 0.0 ? over : 0.0) + (under > 0.0 ? under : 0.0));
  }
  const double mu = 0.02 + 0.1 * cost / n_soft;
  for (int r = 0; r < n_soft; r++) {
    for (int side = 0; side < 2; side++) {
      fsw_soft *f = &w->soft[r][side];
      if (w->weight[r] <= 0.0) continue;
      const double e = side ? w->low[r] - w->value[r] : w->value[r] - w->high[r];
      f->lambda = f->pi = 0.5 * w->weight[r];
      const double margin = mu / f->lambda;
      f->t = (e > 0.0 ? e : 0.0) + margin;
      f->s = f->t - e;
    }
  }
  for (int r = 0; r < n_hard; r++) {
    for (int side = 0; side < 2; side++) {
      fsw_hard *f = &w->hard[r][side];
      const double e = side ? w->hard_low[r] - w->hard_value[r] : w->hard_value[r] - w->hard_high[r];
      f->s = -e > 0.05 ? -e : 0.05;
      f->lambda = mu / f->s;
    }
  }
}

/* Residuals of the rows, their pivots, their complementarity and the stationarity residual (in dual[]). */
static double residuals(const fsw_nmpc_model *m, fsw_workspace *w, int n_soft, int n_hard, double *primal, double *dual) {
  const int nv = 2 * m->n_blocks;
  double gap = 0.0, coefficient[FSW_MAX_SOFT], hard_coefficient[FSW_MAX_HARD];
  *primal = *dual = 0.0;
  for (int r = 0; r < n_soft; r++) {
    coefficient[r] = 0.0;
    if (w->weight[r] <= 0.0) continue;
    for (int side = 0; side < 2; side++) {
      fsw_soft *f = &w->soft[r][side];
      const double e = side ? w->low[r] - w->value[r] : w->value[r] - w->high[r];
      f->residual = e - f->t + f->s;
      if (fabs(f->residual) > *primal) *primal = fabs(f->residual);
      gap += f->s * f->lambda + f->t * f->pi;
      f->per_pi = 1.0 / f->pi;
      f->per_lambda = 1.0 / f->lambda;
      f->pivot = 1.0 / (f->t * f->per_pi + f->s * f->per_lambda);
      coefficient[r] += side ? -f->lambda : f->lambda;
    }
  }
  for (int r = 0; r < n_hard; r++) {
    hard_coefficient[r] = 0.0;
    for (int side = 0; side < 2; side++) {
      fsw_hard *f = &w->hard[r][side];
      const double e = side ? w->hard_low[r] - w->hard_value[r] : w->hard_value[r] - w->hard_high[r];
      f->residual = e + f->s;
      if (fabs(f->residual) > *primal) *primal = fabs(f->residual);
      gap += f->s * f->lambda;
      f->per_lambda = 1.0 / f->lambda;
      f->pivot = f->lambda / f->s;
      hard_coefficient[r] += side ? -f->lambda : f->lambda;
    }
  }
  for (int j = 0; j < nv; j++) w->dual[j] = w->gradient[j];
  for (int j = 0; j < nv; j++) {
    for (int l = 0; l < j; l++) {
      w->dual[j] += w->hessian[j][l] * w->z[l];
      w->dual[l] += w->hessian[j][l] * w->z[j];
    }
    w->dual[j] += w->hessian[j][j] * w->z[j];
  }
  add_transposed(m, w, coefficient, hard_coefficient, w->dual);
  for (int j = 0; j < nv; j++)
    if (fabs(w->dual[j]) > *dual) *dual = fabs(w->dual[j]);
  return gap;
}

/* Cholesky factor of the lower triangle in place, RANK columns at a time; also 1 / diagonal. */
static int cholesky(double (*k)[FSW_MAX_VARS], double *per_diagonal, int n) {
  double column[RANK][FSW_MAX_VARS];
  for (int p = 0; p < n; p += RANK) {
    const int size = n - p < RANK ? n - p : RANK;
    for (int q = 0; q < size; q++) { /* the panel's columns, one after the other */
      const int c = p + q;
      for (int e = 0; e < q; e++) {
        const double f = column[e][c];
        for (int j = c; j < n; j++) k[j][c] -= column[e][j] * f;
      }
      const double pivot = k[c][c];
      if (!(pivot > 0.0) || !is_finite(pivot)) return FSW_FAILED;
      const double root = sqrt(pivot);
      per_diagonal[c] = 1.0 / root;
      for (int j = c; j < n; j++) column[q][j] = k[j][c] = k[j][c] * per_diagonal[c];
    }
    if (size < RANK) break;
    const double *restrict a0 = column[0], *restrict a1 = column[1], *restrict a2 = column[2], *restrict a3 = column[3];
    for (int j = p + RANK; j < n; j++) {
      double *restrict row = k[j];
      const double f0 = a0[j], f1 = a1[j], f2 = a2[j], f3 = a3[j];
      for (int l = p + RANK; l <= j; l++) row[l] -= f0 * a0[l] + f1 * a1[l] + f2 * a2[l] + f3 * a3[l];
    }
  }
  return FSW_OK;
}

/* Normal matrix H + sum D a a', factored in place (Cholesky, lower triangle). */
static int factorise(const fsw_nmpc_model *m, fsw_workspace *w) {
  const int nv = 2 * m->n_blocks, n_rows = 2 * m->n_out;
  double(*k)[FSW_MAX_VARS] = w->factor;
  for (int j = 0; j < nv; j++)
    for (int l = 0; l <= j; l++) k[j][l] = w->hessian[j][l];
  for (int r = 0; r < n_rows; r += RANK) { /* several rows at a time: fewer passes over the matrix */
    const double *a[RANK];
    double d[RANK];
    int widest = 0;
    for (int i = 0; i < RANK; i++) {
      const int row = r + i < n_rows ? r + i : r;
      int width;
      a[i] = output_row(m, w, row, &width);
      d[i] = r + i < n_rows && w->weight[row] > 0.0 ? w->soft[row][0].pivot + w->soft[row][1].pivot : 0.0;
      if (d[i] > 0.0 && width > widest) widest = width;
    }
    for (int j = 0; j < widest; j++) {
      const double d0 = d[0] * a[0][j], d1 = d[1] * a[1][j], d2 = d[2] * a[2][j], d3 = d[3] * a[3][j];
      const double *restrict a0 = a[0], *restrict a1 = a[1], *restrict a2 = a[2], *restrict a3 = a[3];
      double *restrict row = k[j];
      for (int l = 0; l <= j; l++) row[l] += d0 * a0[l] + d1 * a1[l] + d2 * a2[l] + d3 * a3[l];
    }
  }
  w->suffix[m->n_blocks][0] = w->suffix[m->n_blocks][1] = 0.0;
  for (int b = m->n_blocks - 1; b >= 0; b--)
    for (int q = 0; q < 2; q++) {
      const fsw_hard *f = w->hard[nv + 2 * b + q];
      w->suffix[b][q] = w->suffix[b + 1][q] + f[0].pivot + f[1].pivot;
    }
  for (int j = 0; j < nv; j++) {
    const fsw_hard *box = w->hard[j];
    k[j][j] += box[0].pivot + box[1].pivot;
    if (w->weight[n_rows + j] > 0.0)
      k[j][j] += w->soft[n_rows + j][0].pivot + w->soft[n_rows + j][1].pivot;
    const double f = w->size[j] * w->scale[j] * w->suffix[j >> 1][j & 1];
    for (int l = j & 1; l <= j; l += 2) k[j][l] += f * w->size[l] * w->scale[l];
  }
  return cholesky(k, w->per_diagonal, nv);
}

/* Newton direction for a centring target mu; `second` adds the second-order terms of the direction held now. */
static void direction(const fsw_nmpc_model *m, fsw_workspace *w, int n_soft, int n_hard, double mu, int second) {
  const int nv = 2 * m->n_blocks;
  double coefficient[FSW_MAX_SOFT], hard_coefficient[FSW_MAX_HARD];
  for (int r = 0; r < n_soft; r++) {
    coefficient[r] = 0.0;
    if (w->weight[r] <= 0.0) continue;
    for (int side = 0; side < 2; side++) {
      fsw_soft *f = &w->soft[r][side];
      const double c1 = mu - f->s * f->lambda - (second ? f->ds * f->dlambda : 0.0);
      const double c2 = mu - f->t * f->pi + (second ? f->dt * f->dlambda : 0.0);
      f->shift = f->residual - c2 * f->per_pi + c1 * f->per_lambda;
      f->ds = c1;
      f->dt = c2;
      const double g = f->pivot * f->shift;
      coefficient[r] -= side ? -g : g;
    }
  }
  for (int r = 0; r < n_hard; r++) {
    hard_coefficient[r] = 0.0;
    for (int side = 0; side < 2; side++) {
      fsw_hard *f = &w->hard[r][side];
      const double c1 = mu - f->s * f->lambda - (second ? f->ds * f->dlambda : 0.0);
      f->shift = f->residual + c1 * f->per_lambda;
      f->ds = c1;
      const double g = f->pivot * f->shift;
      hard_coefficient[r] -= side ? -g : g;
    }
  }
  double *x = w->step;
  for (int j = 0; j < nv; j++) x[j] = -w->dual[j];
  add_transposed(m, w, coefficient, hard_coefficient, x);
  for (int j = 0; j < nv; j++) x[j] = (x[j] - dot(w->factor[j], x, j)) * w->per_diagonal[j];
  for (int j = nv - 1; j >= 0; j--) {
    x[j] *= w->per_diagonal[j];
    const double xj = x[j];
    for (int l = 0; l < j; l++) x[l] -= w->factor[j][l] * xj;
  }
  row_products(m, w, x, w->change, w->hard_change);
  for (int r = 0; r < n_soft; r++) {
    if (w->weight[r] <= 0.0) continue;
    for (int side = 0; side < 2; side++) {
      fsw_soft *f = &w->soft[r][side];
      const double de = side ? -w->change[r] : w->change[r];
      f->dlambda = f->pivot * (de + f->shift);
      f->ds = (f->ds - f->s * f->dlambda) * f->per_lambda;
      f->dt = (f->dt + f->t * f->dlambda) * f->per_pi;
    }
  }
  for (int r = 0; r < n_hard; r++)
    for (int side = 0; side < 2; side++) {
      fsw_hard *f = &w->hard[r][side];
      const double de = side ? -w->hard_change[r] : w->hard_change[r];
      f->dlambda = f->pivot * (de + f->shift);
      f->ds = (f->ds - f->s * f->dlambda) * f->per_lambda;
    }
}

static double shorten(double alpha, double value, double change) {
  return change < 0.0 && -value / change < alpha ? -value / change : alpha;
}

/* Longest step (at most 1) that keeps everything positive, and the complementarity at its end. */
static double longest_step(const fsw_workspace *w, int n_soft, int n_hard, double *gap) {
  double alpha = 1.0;
  for (int r = 0; r < n_soft; r++) {
    if (w->weight[r] <= 0.0) continue;
    for (int side = 0; side < 2; side++) {
      const fsw_soft *f = &w->soft[r][side];
      alpha = shorten(shorten(alpha, f->s, f->ds), f->t, f->dt);
      alpha = shorten(shorten(alpha, f->lambda, f->dlambda), f->pi, -f->dlambda);
    }
  }
  for (int r = 0; r < n_hard; r++)
    for (int side = 0; side < 2; side++) {
      const fsw_hard *f = &w->hard[r][side];
      alpha = shorten(shorten(alpha, f->s, f->ds), f->lambda, f->dlambda);
    }
  *gap = 0.0;
  for (int r = 0; r < n_soft; r++) {
    if (w->weight[r] <= 0.0) continue;
    for (int side = 0; side < 2; side++) {
      const fsw_soft *f = &w->soft[r][side];
      *gap += (f->s + alpha * f->ds) * (f->lambda + alpha * f->dlambda) + (f->t + alpha * f->dt) * (f->pi - alpha * f->dlambda);
    }
  }
  for (int r = 0; r < n_hard; r++)
    for (int side = 0; side < 2; side++) {
      const fsw_hard *f = &w->hard[r][side];
      *gap += (f->s + alpha * f->ds) * (f->lambda + alpha * f->dlambda);
    }
  return alpha;
}

static void advance(const fsw_nmpc_model *m, fsw_workspace *w, int n_soft, int n_hard, double alpha) {
  const int nv = 2 * m->n_blocks;
  for (int j = 0; j < nv; j++) w->z[j] += alpha * w->step[j];
  for (int r = 0; r < n_soft; r++) {
    w->value[r] += alpha * w->change[r];
    if (w->weight[r] <= 0.0) continue;
    for (int side = 0; side < 2; side++) {
      fsw_soft *f = &w->soft[r][side];
      f->s += alpha * f->ds;
      f->t += alpha * f->dt;
      f->lambda += alpha * f->dlambda;
      f->pi -= alpha * f->dlambda;
    }
  }
  for (int r = 0; r < n_hard; r++) {
    w->hard_value[r] += alpha * w->hard_change[r];
    for (int side = 0; side < 2; side++) {
      fsw_hard *f = &w->hard[r][side];
      f->s += alpha * f->ds;
      f->lambda += alpha * f->dlambda;
    }
  }
}

static double cost_of(const fsw_nmpc_model *m, const fsw_workspace *w, int n_soft) {
  const int nv = 2 * m->n_blocks;
  double cost = 0.0;
  for (int r = 0; r < n_soft; r++) {
    const double over = w->value[r] - w->high[r], under = w->low[r] - w->value[r];
    cost += w->weight[r] * ((over > 0.0 ? over : 0.0) + (under > 0.0 ? under : 0.0));
  }
  for (int j = 0; j < nv; j++) {
    cost += w->gradient[j] * w->z[j] + 0.5 * w->hessian[j][j] * w->z[j] * w->z[j];
    cost += w->z[j] * dot(w->hessian[j], w->z, j);
  }
  return cost;
}

int fsw_nmpc_solve(const fsw_nmpc_model *m, const fsw_nmpc_call *c, double *v, double *depth, double *temp,
                   fsw_nmpc_result *result, void *workspace) {
  fsw_workspace *w = workspace;
  const int nv = 2 * m->n_blocks, n_soft = 2 * m->n_out + nv, n_hard = 2 * nv;
  fsw_nmpc_result r = {FSW_FAILED, 0, 0.0, 0.0, 0.0, 0.0};
  *result = r;
  if (fsw_predict_into(m, c, v, w) != FSW_OK) return result->status;
  build(m, c, v, w);
  start(m, w, n_soft, n_hard);
  int pairs = 2 * n_hard;
  for (int i = 0; i < n_soft; i++)
    if (w->weight[i] > 0.0) pairs += 4;
  r.status = FSW_CAP;
  for (r.iterations = 0;; r.iterations++) {
    r.gap = residuals(m, w, n_soft, n_hard, &r.primal_residual, &r.dual_residual);
    r.cost = cost_of(m, w, n_soft);
    if (!is_finite(r.gap + r.cost)) { r.status = FSW_FAILED; break; }
    if (r.gap <= c->tolerance * (1.0 + fabs(r.cost)) && r.primal_residual <= 1e-7 && r.dual_residual <= 1e-6) {
      r.status = FSW_OK;
      break;
    }
    if (r.iterations >= c->max_iterations) break;
    if (factorise(m, w) != FSW_OK) { r.status = FSW_FAILED; break; }
    double reached;
    direction(m, w, n_soft, n_hard, 0.0, 0);
    longest_step(w, n_soft, n_hard, &reached);
    const double ratio = reached / r.gap;
    direction(m, w, n_soft, n_hard, ratio * ratio * ratio * r.gap / pairs, 1);
    const double alpha = longest_step(w, n_soft, n_hard, &reached);
    advance(m, w, n_soft, n_hard, alpha < 1.0 ? STEP_TO_BOUNDARY * alpha : 1.0);
  }
  if (r.status != FSW_FAILED) {
    for (int j = 0; j < nv; j++) v[j] = w->z[j] * w->scale[j];
    for (int i = 0; i < m->n_out; i++) { /* outputs of the linear model at the solution */
      depth[i] = w->depth[i] + w->value[i];
      temp[i] = w->temp[i] + w->value[m->n_out + i];
    }
  }
  *result = r;
  return r.status;
}

int fsw_nmpc_workspace_bytes(void) { return (int)sizeof(fsw_workspace); }

#ifndef FSW_NMPC_ID
#define FSW_NMPC_ID "unknown"
#endif
const char *fsw_nmpc_id(void) { return FSW_NMPC_ID; }
