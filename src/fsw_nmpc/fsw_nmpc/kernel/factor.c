/* The normal matrix of an interior-point iteration and its Cholesky factor (upper triangle). */
#include <math.h>

#include "internal.h"

/* Sums are formed in tiles of BLOCK rows and TILE columns, as large as the registers permit. Each
 * sum has the same terms in the same order whatever the tile, so results do not depend on the
 * machine. Both divide FSW_PAD. */
#ifdef __arm__
#define BLOCK 2
#define TILE 4
#else
#define BLOCK 4
#define TILE 8
#endif
/* Near the solution pivots differ by so many decades that rounding would leave pivots of pure
 * noise, and directions that no longer reduce the stationarity residual. */
#define ABOVE_ROUNDING 2e-15

/* First row in use from `begin` on that depends on variable j; widths do not decrease before
 * `end`. */
static int first_wider(const fsw_workspace *w, int begin, int end, int j) {
  while (begin < end && w->row_width[begin] <= j) begin++;
  return begin;
}

/* acc += sum over rows of weighted a[l..l+TILE) */
static void accumulate(const fsw_workspace *w, int begin, int end, int l, double (*restrict acc)[TILE]) {
  for (int r = begin; r < end; r++) {
    const double *restrict a = w->by[w->row[r]] + l, *restrict d = w->scratch.matrices.weighted[r];
    for (int i = 0; i < BLOCK; i++)
      for (int q = 0; q < TILE; q++) acc[i][q] += d[i] * a[q];
  }
}

/* weighted = pivot a[j..j+BLOCK) */
static void weigh(fsw_workspace *w, int begin, int end, int j) {
  for (int r = begin; r < end; r++) {
    const double *restrict a = w->by[w->row[r]] + j, pivot = w->row_pivot[r];
    double *restrict d = w->scratch.matrices.weighted[r];
    for (int i = 0; i < BLOCK; i++) d[i] = pivot * a[i];
  }
}

/* sum += pivot a a' of the rows in use from begin to end */
static void add_rows(fsw_workspace *w, int begin, int end, double (*restrict sum)[FSW_STRIDE]) {
  const int n_depth = w->n_depth, middle = begin > n_depth ? begin : end < n_depth ? end : n_depth;
  for (int j = 0; j < w->nv; j += BLOCK) {
    int depth_from = first_wider(w, begin, middle, j), temp_from = first_wider(w, middle, end, j);
    weigh(w, depth_from, middle, j);
    weigh(w, temp_from, end, j);
    for (int l = j / TILE * TILE; l < w->nv; l += TILE) {
      double acc[BLOCK][TILE];
      for (int i = 0; i < BLOCK; i++)
        for (int q = 0; q < TILE; q++) acc[i][q] = sum[j + i][l + q];
      depth_from = first_wider(w, depth_from, middle, l);
      temp_from = first_wider(w, temp_from, end, l);
      accumulate(w, depth_from, middle, l, acc);
      accumulate(w, temp_from, end, l, acc);
      for (int i = 0; i < BLOCK; i++)
        for (int q = 0; q < TILE; q++) sum[j + i][l + q] = acc[i][q];
    }
  }
}

/* sum of pivot a a' of all rows in use. Rows without a soft side have constant pivots during a
 * solve: the sum over the leading ones, often most of the work, is kept. */
static void sum_rows(fsw_workspace *w, int again) {
  double (*restrict kept)[FSW_STRIDE] = w->scratch.matrices.kept, (*restrict sum)[FSW_STRIDE] = w->scratch.matrices.factor;
  const int n_kept = w->n_kept, n = (w->nv + FSW_PAD - 1) / FSW_PAD * FSW_PAD;
  if (!again) {
    for (int j = 0; j < n; j++)
      for (int l = 0; l < n; l++) kept[j][l] = 0.0;
    add_rows(w, 0, n_kept, kept);
  }
  for (int j = 0; j < n; j++)
    for (int l = j / TILE * TILE; l < n; l++) sum[j][l] = kept[j][l];
  add_rows(w, n_kept, w->n_rows, sum);
}

static void assemble(fsw_workspace *w, int again) {
  const int nv = w->nv;
  sum_rows(w, again);
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

/* Upper Cholesky factor in place, BLOCK rows at a time (Golub and Van Loan, section 4.2); also
 * 1 / diagonal. The contributions of the rows above are subtracted term by term: their sum would
 * swamp the remainder when pivots differ by many decades. */
static int cholesky(double (*k)[FSW_STRIDE], double *per_diagonal, int n) {
  for (int p = 0; p < n; p += BLOCK) {
    const int end = p + BLOCK < n ? p + BLOCK : n;
    for (int l = p / TILE * TILE; l < n; l += TILE) { /* a tile at a time */
      double acc[BLOCK][TILE];
      for (int i = 0; i < BLOCK; i++)
        for (int q = 0; q < TILE; q++) acc[i][q] = k[p + i][l + q];
      for (int e = 0; e < p; e++) {
        const double *restrict a = k[e] + l, *restrict d = k[e] + p;
        for (int i = 0; i < BLOCK; i++)
          for (int q = 0; q < TILE; q++) acc[i][q] -= d[i] * a[q];
      }
      for (int i = 0; i < BLOCK; i++)
        for (int q = 0; q < TILE; q++) k[p + i][l + q] = acc[i][q];
    }
    for (int c = p; c < end; c++) { /* the block's rows, one after the other */
      double *restrict row = k[c];
      for (int e = p; e < c; e++) {
        const double *restrict above = k[e];
        const double f = above[c];
        for (int l = c; l < n; l++) row[l] -= f * above[l];
      }
      if (!fsw_is_finite(row[c])) return FSW_NOT_FINITE;
      /* lost to rounding near the solution: the variable then keeps its value in this iteration */
      const double per = per_diagonal[c] = row[c] > 0.0 ? 1.0 / sqrt(row[c]) : 0.0;
      for (int l = c; l < n; l++) row[l] *= per;
    }
  }
  return FSW_OK;
}

/* Assemble diagonal + sum of pivot a a' and factor it; `again`: not the first time in a solve. */
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
