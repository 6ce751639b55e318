/* Memory of the solver; not part of the interface. */
#ifndef FSW_WORKSPACE_H
#define FSW_WORKSPACE_H

enum {
  FSW_PAD = 8,                                 /* matrix rows are padded to a multiple of it */
  FSW_STRIDE = (FSW_MAX_VARS + FSW_PAD - 1) / FSW_PAD * FSW_PAD,
  FSW_MAX_ROWS = 2 * FSW_MAX_OUT,              /* depth and temperature at every output point */
  FSW_MAX_SOFT = 2 * FSW_MAX_ROWS + FSW_MAX_VARS, /* above and below the dead-bands; moves */
  FSW_MAX_HARD = 4 * FSW_MAX_VARS              /* moves and block-end inputs, above and below */
};

/* Soft sides: e = t - s. The violation t >= 0 has the price `weight` (dual pi), the slack s >= 0
 * the dual lambda, and lambda + pi = weight. */
typedef struct {
  double e[FSW_MAX_SOFT], weight[FSW_MAX_SOFT];
  double t[FSW_MAX_SOFT], pi[FSW_MAX_SOFT], s[FSW_MAX_SOFT], lambda[FSW_MAX_SOFT];
  double dt[FSW_MAX_SOFT], ds[FSW_MAX_SOFT], dlambda[FSW_MAX_SOFT];
  double per_t[FSW_MAX_SOFT], per_pi[FSW_MAX_SOFT], per_s[FSW_MAX_SOFT], per_lambda[FSW_MAX_SOFT];
  double residual[FSW_MAX_SOFT], pivot[FSW_MAX_SOFT], shift[FSW_MAX_SOFT], work[FSW_MAX_SOFT];
} fsw_soft;

/* Hard sides: e = -s, s >= 0 with dual lambda. */
typedef struct {
  double e[FSW_MAX_HARD], s[FSW_MAX_HARD], lambda[FSW_MAX_HARD], ds[FSW_MAX_HARD], dlambda[FSW_MAX_HARD];
  double per_s[FSW_MAX_HARD], per_lambda[FSW_MAX_HARD];
  double residual[FSW_MAX_HARD], pivot[FSW_MAX_HARD], shift[FSW_MAX_HARD], work[FSW_MAX_HARD];
} fsw_hard;

typedef struct { /* used during the prediction only */
  double power[FSW_MAX_STEPS][3];
  double d_power[FSW_MAX_STEPS][3][FSW_MAX_VARS];
  int width[FSW_MAX_STEPS];
  double d_creep[FSW_MAX_VARS], d_slow[FSW_MAX_VARS], d_copper[FSW_MAX_VARS], d_tool[FSW_MAX_VARS];
  double d_motor[FSW_MAX_VARS], d_depth[FSW_MAX_VARS], d_left[FSW_MAX_VARS], d_right[FSW_MAX_VARS];
  double count[FSW_MAX_BLOCKS];
} fsw_path;

typedef struct { /* used after the prediction only */
  double factor[FSW_STRIDE][FSW_STRIDE];
  double weighted[FSW_MAX_ROWS][FSW_PAD];          /* some columns of the rows, times the pivots */
  double kept[FSW_STRIDE][FSW_STRIDE];             /* part that is constant during a solve */
} fsw_matrices;

typedef struct {
  union { fsw_path path; fsw_matrices matrices; } scratch;
  double output[FSW_MAX_ROWS];                   /* depth, temperature; in the QP: without moves */
  double by[FSW_MAX_ROWS][FSW_STRIDE];           /* sensitivities; in the QP: by scaled moves */
  /* quadratic program in scaled moves */
  int nv, n_rows, n_soft_rows, n_moves;          /* variables, rows, rows and moves with L1 cost */
  int row[FSW_MAX_ROWS], row_width[FSW_MAX_ROWS]; /* output of a row, leading variables */
  int n_depth, n_kept;                           /* rows of the depth, which come first; those before the first L1 cost */
  int soft_row[FSW_MAX_ROWS];                    /* rows with L1 cost */
  int move[FSW_MAX_VARS];                        /* variables of the moves with L1 weight */
  double scale[FSW_MAX_VARS], size[FSW_MAX_VARS]; /* largest move; largest change within a block */
  double diagonal[FSW_MAX_VARS], gradient[FSW_MAX_VARS];
  double low[FSW_MAX_ROWS], high[FSW_MAX_ROWS], square[FSW_MAX_ROWS];
  double input_low[FSW_MAX_VARS], input_high[FSW_MAX_VARS];
  double per_diagonal[FSW_MAX_VARS];
  double z[FSW_STRIDE], step[FSW_STRIDE], dual[FSW_STRIDE];
  double value[FSW_MAX_ROWS], change[FSW_MAX_ROWS]; /* a'z and a'dz of the rows in use */
  double input[FSW_MAX_VARS], input_change[FSW_MAX_VARS];
  double row_force[FSW_MAX_ROWS], input_force[FSW_MAX_VARS], row_pivot[FSW_MAX_ROWS];
  fsw_soft soft;
  fsw_hard hard;
} fsw_workspace;

#endif
