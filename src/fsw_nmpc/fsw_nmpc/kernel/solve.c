/* Condensed QP with L1 dead-band costs (28), (34), (35), solved by Mehrotra's predictor-corrector
 * interior-point method (Mehrotra 1992; Nocedal and Wright, section 16.6).
 *
 * min  1/2 z'Dz + g'z + sum_r w_r (max(0, a_r'z - high_r) + max(0, low_r - a_r'z))
 *      + 1/2 q_r (a_r'z - centre_r)^2
 * s.t. |z_j| <= 1 and bounds on the inputs at the end of every block.
 *
 * Violations, slacks and duals are eliminated, so each iteration factors one dense matrix of the
 * size of z. The number of iterations hardly depends on which limits are active, which suits a
 * deadline. */
#include <math.h>

#include "internal.h"

#define STEP_TO_BOUNDARY 0.995
#define SHORT_STEP 0.3
/* start complementarity: lower bound, and share of the mean cost of a side */
#define LEAST_START 0.02
#define START_SHARE 0.1
#define LEAST_SLACK 0.05
/* in scaled moves and inputs */
#define PRIMAL_TOLERANCE 1e-7
#define DUAL_TOLERANCE 1e-6
/* share of the tolerated gap below which smaller complementarity would only cost rank */
#define LEAST_SHARE 0.02

/* Four partial sums: without them each addition would wait for the one before, as C does not let the
 * compiler reorder floating-point sums. */
static double sum_of(const double *x, int n) {
  double sum[4] = {0.0, 0.0, 0.0, 0.0};
  int k = 0;
  for (; k + 4 <= n; k += 4)
    for (int i = 0; i < 4; i++) sum[i] += x[k + i];
  for (; k < n; k++) sum[0] += x[k];
  return (sum[0] + sum[1]) + (sum[2] + sum[3]);
}

static double largest_of(const double *x, int n) {
  double top[4] = {0.0, 0.0, 0.0, 0.0};
  int k = 0;
  for (; k + 4 <= n; k += 4)
    for (int i = 0; i < 4; i++) top[i] = x[k + i] > top[i] ? x[k + i] : top[i];
  for (; k < n; k++) top[0] = x[k] > top[0] ? x[k] : top[0];
  for (int i = 1; i < 4; i++) top[0] = top[i] > top[0] ? top[i] : top[0];
  return top[0];
}

static double largest_size(const double *x, int n) {
  double top = 0.0;
  for (int k = 0; k < n; k++) top = fabs(x[k]) > top ? fabs(x[k]) : top;
  return top;
}

static int n_soft(const fsw_workspace *w) { return 2 * w->n_soft_rows + w->n_moves; }

/* Excess e[] of all sides at z: by how much a row is beyond its bound (negative inside). A soft side
 * costs weight * max(0, e), a hard side has to be at most 0. */
static void sides(fsw_workspace *w) {
  const int n = w->n_soft_rows, nv = w->nv;
  double *e = w->soft.e, *h = w->hard.e;
  for (int k = 0; k < n; k++) {
    const int r = w->soft_row[k];
    e[k] = w->value[r] - w->high[r];
    e[n + k] = w->low[r] - w->value[r];
  }
  for (int k = 0; k < w->n_moves; k++) e[2 * n + k] = w->z[w->move[k]];
  for (int j = 0; j < nv; j++) {
    h[j] = w->z[j] - 1.0;
    h[nv + j] = -1.0 - w->z[j];
    h[2 * nv + j] = w->input[j] - w->input_high[j];
    h[3 * nv + j] = w->input_low[j] - w->input[j];
  }
}

static double cost_of(const fsw_workspace *w) {
  double cost = 0.0;
  for (int k = 0; k < n_soft(w); k++)
    if (w->soft.e[k] > 0.0) cost += w->soft.weight[k] * w->soft.e[k];
  for (int r = 0; r < w->n_rows; r++) {
    const double off = w->value[r] - 0.5 * (w->low[r] + w->high[r]);
    cost += 0.5 * w->square[r] * off * off;
  }
  for (int j = 0; j < w->nv; j++) cost += w->z[j] * (w->gradient[j] + 0.5 * w->diagonal[j] * w->z[j]);
  return cost;
}

/* Start with every soft dual in the middle of its range, equally far from both possible solutions.
 * Warm-started duals would save less than one iteration in ten, and let a bad solve spoil the
 * next. */
static void start(fsw_workspace *w) {
  const int n = n_soft(w);
  fsw_soft *f = &w->soft;
  fsw_hard *h = &w->hard;
  fsw_row_products(w, 0, w->z, w->value, w->input);
  sides(w);
  const double mu = LEAST_START + START_SHARE * fabs(cost_of(w)) / (n + 4 * w->nv);
  for (int k = 0; k < n; k++) {
    f->lambda[k] = f->pi[k] = 0.5 * f->weight[k];
    const double margin = mu / f->lambda[k];
    f->t[k] = (f->e[k] > 0.0 ? f->e[k] : 0.0) + margin;
    f->s[k] = f->t[k] - f->e[k];
  }
  for (int k = 0; k < 4 * w->nv; k++) {
    h->s[k] = -h->e[k] > LEAST_SLACK ? -h->e[k] : LEAST_SLACK;
    h->lambda[k] = mu / h->s[k];
  }
}

/* Residuals and pivots of the sides, complementarity, stationarity residual (in dual[]). One reciprocal
 * of the product serves both factors, as divisions are slow. */
static double residuals(fsw_workspace *w, double *primal, double *dual) {
  const int n = n_soft(w), nv = w->nv, n_rows = w->n_soft_rows;
  fsw_soft *f = &w->soft;
  fsw_hard *h = &w->hard;
  sides(w);
  for (int k = 0; k < n; k++) {
    const double sl = f->s[k] * f->lambda[k], tp = f->t[k] * f->pi[k];
    const double per_sl = 1.0 / sl, per_tp = 1.0 / tp;
    f->per_s[k] = f->lambda[k] * per_sl;
    f->per_lambda[k] = f->s[k] * per_sl;
    f->per_t[k] = f->pi[k] * per_tp;
    f->per_pi[k] = f->t[k] * per_tp;
    f->pivot[k] = 1.0 / (f->t[k] * f->per_pi[k] + f->s[k] * f->per_lambda[k]);
    f->residual[k] = f->e[k] - f->t[k] + f->s[k];
    f->work[k] = sl + tp;
  }
  for (int k = 0; k < 4 * nv; k++) {
    const double sl = h->s[k] * h->lambda[k], per_sl = 1.0 / sl;
    h->per_s[k] = h->lambda[k] * per_sl;
    h->per_lambda[k] = h->s[k] * per_sl;
    h->pivot[k] = h->lambda[k] * h->per_s[k];
    h->residual[k] = h->e[k] + h->s[k];
    h->work[k] = sl;
  }
  const double gap = sum_of(f->work, n) + sum_of(h->work, 4 * nv);
  *primal = fmax(largest_size(f->residual, n), largest_size(h->residual, 4 * nv));
  for (int r = 0; r < w->n_rows; r++) {
    w->row_force[r] = w->square[r] * (w->value[r] - 0.5 * (w->low[r] + w->high[r]));
    w->row_pivot[r] = w->square[r];
  }
  for (int k = 0; k < n_rows; k++) {
    w->row_force[w->soft_row[k]] += f->lambda[k] - f->lambda[n_rows + k];
    w->row_pivot[w->soft_row[k]] += f->pivot[k] + f->pivot[n_rows + k];
  }
  for (int j = 0; j < nv; j++) {
    w->input_force[j] = h->lambda[2 * nv + j] - h->lambda[3 * nv + j];
    w->dual[j] = w->gradient[j] + w->diagonal[j] * w->z[j] + h->lambda[j] - h->lambda[nv + j];
  }
  for (int k = 0; k < w->n_moves; k++) w->dual[w->move[k]] += f->lambda[2 * n_rows + k];
  fsw_add_transposed(w, 0, w->row_force, w->input_force, w->dual);
  *dual = largest_size(w->dual, nv);
  return gap;
}

/* Right-hand side of the condensed Newton system, into w->step. c1 and c2 are the residuals of the
 * two complementarities s lambda = mu and t pi = mu; eliminating ds, dt and dlambda leaves one
 * number per side, which acts on z like a force through its row. */
static void condense(fsw_workspace *w, double mu, double second) {
  const int n = n_soft(w), nv = w->nv, n_rows = w->n_soft_rows;
  fsw_soft *f = &w->soft;
  fsw_hard *h = &w->hard;
  for (int k = 0; k < n; k++) {
    const double c1 = mu - f->s[k] * f->lambda[k] - second * f->ds[k] * f->dlambda[k];
    const double c2 = mu - f->t[k] * f->pi[k] + second * f->dt[k] * f->dlambda[k];
    f->shift[k] = f->residual[k] - c2 * f->per_pi[k] + c1 * f->per_lambda[k];
    f->ds[k] = c1;
    f->dt[k] = c2;
    f->work[k] = f->pivot[k] * f->shift[k];
  }
  for (int k = 0; k < 4 * nv; k++) {
    const double c1 = mu - h->s[k] * h->lambda[k] - second * h->ds[k] * h->dlambda[k];
    h->shift[k] = h->residual[k] + c1 * h->per_lambda[k];
    h->ds[k] = c1;
    h->work[k] = h->pivot[k] * h->shift[k];
  }
  double *x = w->step;
  for (int r = 0; r < w->n_rows; r++) w->row_force[r] = 0.0;
  for (int k = 0; k < n_rows; k++) w->row_force[w->soft_row[k]] = f->work[n_rows + k] - f->work[k];
  for (int j = 0; j < nv; j++) {
    w->input_force[j] = h->work[3 * nv + j] - h->work[2 * nv + j];
    x[j] = h->work[nv + j] - h->work[j] - w->dual[j];
  }
  for (int k = 0; k < w->n_moves; k++) x[w->move[k]] -= f->work[2 * n_rows + k];
}

/* Steps of slacks and duals from the step of the moves, by substituting back what condense()
 * eliminated. work: relative decrease of each; the largest one limits the step (ratio test). */
static void expand(fsw_workspace *w) {
  const int n = n_soft(w), nv = w->nv, n_rows = w->n_soft_rows;
  const double *x = w->step;
  fsw_soft *f = &w->soft;
  fsw_hard *h = &w->hard;
  for (int k = 0; k < n_rows; k++) {
    f->work[k] = w->change[w->soft_row[k]];
    f->work[n_rows + k] = -f->work[k];
  }
  for (int k = 0; k < w->n_moves; k++) f->work[2 * n_rows + k] = x[w->move[k]];
  for (int j = 0; j < nv; j++) {
    h->work[j] = x[j];
    h->work[nv + j] = -x[j];
    h->work[2 * nv + j] = w->input_change[j];
    h->work[3 * nv + j] = -w->input_change[j];
  }
  for (int k = 0; k < n; k++) {
    const double dl = f->pivot[k] * (f->work[k] + f->shift[k]);
    const double ds = (f->ds[k] - f->s[k] * dl) * f->per_lambda[k], dt = (f->dt[k] + f->t[k] * dl) * f->per_pi[k];
    const double by_s = -ds * f->per_s[k], by_t = -dt * f->per_t[k];
    const double by_lambda = -dl * f->per_lambda[k], by_pi = dl * f->per_pi[k];
    const double primal = by_s > by_t ? by_s : by_t, dual = by_lambda > by_pi ? by_lambda : by_pi;
    f->dlambda[k] = dl;
    f->ds[k] = ds;
    f->dt[k] = dt;
    f->work[k] = primal > dual ? primal : dual;
  }
  for (int k = 0; k < 4 * nv; k++) {
    const double dl = h->pivot[k] * (h->work[k] + h->shift[k]);
    const double ds = (h->ds[k] - h->s[k] * dl) * h->per_lambda[k];
    const double by_s = -ds * h->per_s[k], by_lambda = -dl * h->per_lambda[k];
    h->dlambda[k] = dl;
    h->ds[k] = ds;
    h->work[k] = by_s > by_lambda ? by_s : by_lambda;
  }
}

/* Newton direction for a centring target mu; `second` (0 to 1) is the share of the second-order
 * terms (of the predictor held at present). Returns the longest step that keeps all slacks and
 * duals positive, and the complementarity at its end. */
static double direction(fsw_workspace *w, double mu, double second, double *gap_there) {
  const int n = n_soft(w), nv = w->nv;
  fsw_soft *f = &w->soft;
  fsw_hard *h = &w->hard;
  condense(w, mu, second);
  fsw_add_transposed(w, w->n_kept, w->row_force, w->input_force, w->step);
  fsw_substitute(w, w->step);
  /* the predictor, which is not taken, needs the change of soft rows only */
  fsw_row_products(w, gap_there ? w->n_kept : 0, w->step, w->change, w->input_change);
  expand(w);
  const double alpha = 1.0 / fmax(1.0, fmax(largest_of(f->work, n), largest_of(h->work, 4 * nv)));
  if (gap_there) {
    for (int k = 0; k < n; k++)
      f->work[k] = (f->s[k] + alpha * f->ds[k]) * (f->lambda[k] + alpha * f->dlambda[k]) +
                   (f->t[k] + alpha * f->dt[k]) * (f->pi[k] - alpha * f->dlambda[k]);
    for (int k = 0; k < 4 * nv; k++) h->work[k] = (h->s[k] + alpha * h->ds[k]) * (h->lambda[k] + alpha * h->dlambda[k]);
    *gap_there = sum_of(f->work, n) + sum_of(h->work, 4 * nv);
  }
  return alpha;
}

/* Take a step. The products a'z move along linearly, which saves multiplying all rows again. */
static void advance(fsw_workspace *w, double alpha) {
  fsw_soft *f = &w->soft;
  fsw_hard *h = &w->hard;
  for (int j = 0; j < w->nv; j++) {
    w->z[j] += alpha * w->step[j];
    w->input[j] += alpha * w->input_change[j];
  }
  for (int r = 0; r < w->n_rows; r++) w->value[r] += alpha * w->change[r];
  for (int k = 0; k < n_soft(w); k++) {
    f->s[k] += alpha * f->ds[k];
    f->t[k] += alpha * f->dt[k];
    f->lambda[k] += alpha * f->dlambda[k];
    f->pi[k] -= alpha * f->dlambda[k];
  }
  for (int k = 0; k < 4 * w->nv; k++) {
    h->s[k] += alpha * h->ds[k];
    h->lambda[k] += alpha * h->dlambda[k];
  }
}

/* Outputs of the linear model at the solution. A nonlinear prediction would cost another pass over
 * the horizon; the next tick measures the difference. */
static void outputs(const fsw_nmpc_model *m, const fsw_workspace *w, double *depth, double *temp) {
  for (int i = 0, n = m->n_out; i < n; i++) {
    depth[i] = w->output[i] + fsw_dot(w->by[i], w->z, m->depth_width[i]);
    temp[i] = w->output[n + i] + fsw_dot(w->by[n + i], w->z, m->temperature_width[i]);
  }
}

int fsw_solve(fsw_nmpc *c, const fsw_problem *problem, double *v, double *depth, double *temp, fsw_nmpc_output *out) {
  const fsw_nmpc_model *m = &c->model;
  const fsw_nmpc_tuning *t = &c->tuning;
  fsw_workspace *w = &c->workspace;
  int status = FSW_ITERATION_CAP, n = 0;
  out->iterations = 0;
  if (fsw_predict(m, &problem->start, v, w) != FSW_OK) return FSW_NOT_FINITE;
  fsw_build(m, t, problem, v, w);
  start(w);
  const double pairs = 2.0 * n_soft(w) + 4.0 * w->nv;
  for (;; n++) {
    const double gap = out->gap = residuals(w, &out->primal_residual, &out->dual_residual), cost = out->cost = cost_of(w);
    if (!fsw_is_finite(gap + cost)) { status = FSW_NOT_FINITE; break; }
    /* |z| <= 1, so a stationarity residual changes the cost by at most nv times its size */
    const double loss = t->tolerance * (1.0 + fabs(cost)), stationary = loss / w->nv;
    if (gap <= loss && out->primal_residual <= PRIMAL_TOLERANCE &&
        out->dual_residual <= (stationary > DUAL_TOLERANCE ? stationary : DUAL_TOLERANCE)) {
      status = FSW_OK;
      break;
    }
    if (n >= t->max_iterations) break;
    if (fsw_factorise(w, n > 0) != FSW_OK) { status = FSW_NOT_FINITE; break; }
    double reached;
    const double ahead = direction(w, 0.0, 0.0, &reached);
    const double ratio = reached / gap, wanted = ratio * ratio * ratio * gap, least = LEAST_SHARE * loss;
    /* Mehrotra's target mu = (gap ahead / gap)^3 gap. Full second-order terms after a short step
     * could cycle; complementarity below the tolerance would cost rank. */
    const double alpha = direction(w, (wanted > least ? wanted : least) / pairs, ahead > SHORT_STEP ? 1.0 : ahead, 0);
    advance(w, alpha < 1.0 ? STEP_TO_BOUNDARY * alpha : 1.0);
  }
  if (status != FSW_NOT_FINITE) {
    for (int j = 0; j < w->nv; j++) v[j] = w->z[j] * w->scale[j];
    outputs(m, w, depth, temp);
  }
  out->iterations = n;
  return status;
}
