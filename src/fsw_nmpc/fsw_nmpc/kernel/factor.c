/* The normal matrix of an iteration and its Cholesky factor; only the upper triangle is used. */
#include <math.h>

#include "internal.h"

#define BLOCK 4
/* Near the solution pivots differ by so many decades that rounding would leave pivots of noise, and directions that no
 * longer lower the stationarity residual. */
#define ABOVE_ROUNDING 2e-15

/* From `begin` on, the first row in use that depends on variable j; widths do not fall before `end`. */
static int first_wider(const fsw_workspace *w, int begin, int end, int j) {
  while (begin < end && w->row_width[begin] <= j) begin++;
  return begin;
}

/* acc += sum over rows of weighted[j..j+BLOCK) by[l..l+PAD) */
static void accumulate(const fsw_workspace *w, int begin, int end, int j, int l, double (*restrict acc)[FSW_PAD]) {
  for (int r = begin; r < end; r++) {
    const double *restrict a = w->by[w->row[r]] + l, *restrict d = w->scratch.matrices.weighted[r] + j;
    for (int i = 0; i < BLOCK; i++)
      for (int q = 0; q < FSW_PAD; q++) acc[i][q] += d[i] * a[q];
  }
}

/* sum of pivot a a' over all rows */
static void sum_rows(fsw_workspace *w) {
  const int nv = w->nv;
  for (int r = 0; r < w->n_rows; r++) {
    const double *restrict a = w->by[w->row[r]];
    double *restrict d = w->scratch.matrices.weighted[r];
    for (int j = 0; j < (w->row_width[r] + FSW_PAD - 1) / FSW_PAD * FSW_PAD; j++) d[j] = w->row_pivot[r] * a[j];
  }
  int depth_from = 0, temp_from = w->n_depth;
  for (int l = 0; l < nv; l += FSW_PAD) {
    depth_from = first_wider(w, depth_from, w->n_depth, l);
    temp_from = first_wider(w, temp_from, w->n_rows, l);
    for (int j = 0; j < l + FSW_PAD && j < nv; j += BLOCK) {
      double acc[BLOCK][FSW_PAD] = {{0.0}};
      accumulate(w, depth_from, w->n_depth, j, l, acc);
      accumulate(w, temp_from, w->n_rows, j, l, acc);
      for (int i = 0; i < BLOCK; i++)
        for (int q = 0; q < FSW_PAD; q++) w->scratch.matrices.factor[j + i][l + q] = acc[i][q];
    }
  }
}

static void copy(double (*restrict to)[FSW_STRIDE], double (*restrict from)[FSW_STRIDE], int n) {
  for (int j = 0; j < n; j++)
    for (int l = j / FSW_PAD * FSW_PAD; l < n; l++) to[j][l] = from[j][l];
}

/* Rows without a soft side have the same pivots in all iterations of a solve: then their sum, the most of the work, is
 * kept where the weighted rows were, which are no longer needed. */
static void assemble(fsw_workspace *w, int again) {
  const int nv = w->nv, stays = w->n_soft_rows == 0;
  if (again && stays) copy(w->scratch.matrices.factor, w->scratch.matrices.weighted, nv);
  else sum_rows(w);
  if (!again && stays) copy(w->scratch.matrices.weighted, w->scratch.matrices.factor, nv);
  /* inputs at the ends of the blocks: moves of the same input add up */
  const double *input_above = w->hard.pivot + 2 * nv, *input_below = w->hard.pivot + 3 * nv;
  double sum[2] = {0.0, 0.0}, ends[2][FSW_MAX_VARS];
  for (int j = nv - 1; j >= 0; j--) {
    sum[j & 1] += input_above[j] + input_below[j];
    ends[j & 1][j] = w->size[j] * sum[j & 1];
    ends[!(j & 1)][j] = 0.0;
  }
  for (int j = 0; j < nv; j++) {
    double *restrict k = w->scratch.matrices.factor[j];
    const double *restrict end = ends[j & 1], size = w->size[j];
    for (int l = j; l < nv; l++) k[l] += size * end[l];
    k[j] += w->diagonal[j] + w->hard.pivot[j] + w->hard.pivot[nv + j];
  }
  for (int k = 0; k < w->n_moves; k++) w->scratch.matrices.factor[w->move[k]][w->move[k]] += w->soft.pivot[2 * w->n_soft_rows + k];
  for (int j = 0; j < nv; j++) w->scratch.matrices.factor[j][j] *= 1.0 + ABOVE_ROUNDING;
}

/* Upper Cholesky factor in place, BLOCK rows at a time; also 1 / diagonal. What the rows above take is subtracted term by
 * term: summed up first it would drown what is left where pivots differ by many decades. */
static int cholesky(double (*k)[FSW_STRIDE], double *per_diagonal, int n) {
  for (int p = 0; p < n; p += BLOCK) {
    const int end = p + BLOCK < n ? p + BLOCK : n;
    for (int l = p / FSW_PAD * FSW_PAD; l < n; l += FSW_PAD) { /* a tile at a time */
      double acc[BLOCK][FSW_PAD];
      for (int i = 0; i < BLOCK; i++)
        for (int q = 0; q < FSW_PAD; q++) acc[i][q] = k[p + i][l + q];
      for (int e = 0; e < p; e++) {
        const double *restrict a = k[e] + l, *restrict d = k[e] + p;
        for (int i = 0; i < BLOCK; i++)
          for (int q = 0; q < FSW_PAD; q++) acc[i][q] -= d[i] * a[q];
      }
      for (int i = 0; i < BLOCK; i++)
        for (int q = 0; q < FSW_PAD; q++) k[p + i][l + q] = acc[i][q];
    }
    for (int c = p; c < end; c++) { /* the block's rows, one after the other */
      double *restrict row = k[c];
      for (int e = p; e < c; e++) {
        const double *restrict above = k[e];
        const double f = above[c];
        for (int l = c; l < n; l++) row[l] -= f * above[l];
      }
      if (!fsw_is_finite(row[c])) return FSW_NOT_FINITE;
      /* lost to rounding near the solution, where pivots differ by many decades: this variable stays where it is */
      const double per = per_diagonal[c] = row[c] > 0.0 ? 1.0 / sqrt(row[c]) : 0.0;
      for (int l = c; l < n; l++) row[l] *= per;
    }
  }
  return FSW_OK;
}

/* diagonal + sum of pivot a a' over all rows, factored into the workspace; `again`: not the first time in a solve. */
int fsw_factorise(fsw_workspace *w, int again) {
  assemble(w, again);
  return cholesky(w->scratch.matrices.factor, w->per_diagonal, w->nv);
}

/* x = matrix^-1 x */
void fsw_substitute(const fsw_workspace *w, double *restrict x) {
  const int nv = w->nv;
  for (int j = 0; j < nv; j++) {
    const double *restrict row = w->scratch.matrices.factor[j];
    const double xj = x[j] *= w->per_diagonal[j];
    for (int l = j + 1; l < nv; l++) x[l] -= row[l] * xj;
  }
  for (int j = nv - 1; j >= 0; j--) x[j] = (x[j] - fsw_dot(w->scratch.matrices.factor[j] + j + 1, x + j + 1, nv - j - 1)) * w->per_diagonal[j];
}
