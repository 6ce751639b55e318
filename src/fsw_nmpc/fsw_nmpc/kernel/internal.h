/* Shared by the kernel's files; not part of its interface. */
#ifndef FSW_NMPC_INTERNAL_H
#define FSW_NMPC_INTERNAL_H

#include "fsw_nmpc.h"

#define FSW_OK 0
#define FSW_CAP 1
#define FSW_FAILED 2

/* Rows with an L1 dead-band cost: depth and temperature at every output point, then every move. */
#define FSW_MAX_SOFT (2 * FSW_MAX_OUT + FSW_MAX_VARS)
/* Rows with a hard limit: every move, then both inputs at the end of every block. */
#define FSW_MAX_HARD (2 * FSW_MAX_VARS)

typedef struct { double t, pi, s, lambda, dt, ds, dlambda, residual, shift, pivot, per_pi, per_lambda; } fsw_soft; /* one side of a soft row */
typedef struct { double s, lambda, ds, dlambda, residual, shift, pivot, per_lambda; } fsw_hard; /* one side of a hard row */

typedef struct {
  /* prediction */
  double power[FSW_MAX_STEPS][2];
  double d_power[FSW_MAX_STEPS][2][FSW_MAX_VARS];
  int width[FSW_MAX_STEPS];
  double d_creep[FSW_MAX_VARS], d_slow[FSW_MAX_VARS], d_fast[FSW_MAX_VARS];
  double d_thermal[FSW_MAX_VARS], d_temp[FSW_MAX_VARS], d_depth[FSW_MAX_VARS], count[FSW_MAX_BLOCKS];
  double depth[FSW_MAX_OUT], temp[FSW_MAX_OUT];
  double by_depth[FSW_MAX_OUT][FSW_MAX_VARS], by_temp[FSW_MAX_OUT][FSW_MAX_VARS];
  /* quadratic program in scaled moves */
  double scale[FSW_MAX_VARS], size[FSW_MAX_VARS]; /* largest move; intervals in the block */
  double hessian[FSW_MAX_VARS][FSW_MAX_VARS], gradient[FSW_MAX_VARS];
  double factor[FSW_MAX_VARS][FSW_MAX_VARS], per_diagonal[FSW_MAX_VARS];
  double z[FSW_MAX_VARS], step[FSW_MAX_VARS], rhs[FSW_MAX_VARS], dual[FSW_MAX_VARS];
  double value[FSW_MAX_SOFT], change[FSW_MAX_SOFT]; /* a'z and a'dz of the soft rows */
  double low[FSW_MAX_SOFT], high[FSW_MAX_SOFT], weight[FSW_MAX_SOFT];
  fsw_soft soft[FSW_MAX_SOFT][2];
  double hard_value[FSW_MAX_HARD], hard_change[FSW_MAX_HARD], hard_low[FSW_MAX_HARD], hard_high[FSW_MAX_HARD];
  fsw_hard hard[FSW_MAX_HARD][2];
  double suffix[FSW_MAX_BLOCKS + 1][2];
} fsw_workspace;

static inline int is_finite(double x) { return x - x == 0.0; }

int fsw_predict_into(const fsw_nmpc_model *m, const fsw_nmpc_call *c, const double *v, fsw_workspace *w);

#endif
