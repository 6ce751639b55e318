/* Real-time iteration of the welding NMPC: prediction with exact sensitivities, and a condensed QP solved by a
 * primal-dual interior-point method with a fixed cap of iterations. Portable C99: no heap, no globals, no libm but sqrt
 * and fabs. All memory is the caller's workspace of fsw_nmpc_workspace_bytes() bytes, 8-byte aligned.
 *
 * Units: mm, degC, kN, rpm, kW, N m, s. Variables: v[2 b] is the force move (kN per interval) and v[2 b + 1] the speed
 * move (rpm per interval) of block b; within a block the input ramps by the same move every interval. */
#ifndef FSW_NMPC_H
#define FSW_NMPC_H

#define FSW_MAX_STEPS 80
#define FSW_MAX_OUT 54
#define FSW_MAX_BLOCKS 54
#define FSW_MAX_VARS (2 * FSW_MAX_BLOCKS)
#define FSW_MODES 10

typedef struct { /* constant per configuration */
  int n_steps;                 /* model steps: every interval is one or more of them */
  int n_out;                   /* output points = intervals */
  int n_blocks;                /* blocks of moves */
  int n_history;               /* power segments before now */
  const int *step_interval;    /* [n_steps] interval of each step */
  const int *interval_block;   /* [n_out] block of each interval */
  const int *out_step;         /* [n_out] the step whose end is the output point */
  const int *depth_width;      /* [n_out] how many leading variables the depth at the output point depends on */
  const int *temp_width;       /* [n_out] likewise for the temperature */
  const double *modes;         /* [n_steps * FSW_MODES] creep, e1, g1, e2, g2, p_tt, p_tT, p_TT, c_t, c_T */
  const int *weight_start;     /* [n_steps + 1] first delayed-power weight of each step */
  const int *weight_segment;   /* power segment, history first */
  const double *weight;        /* 4 per entry: thermal depth by left, right; temperature by left, right */
  const double *torque_par;    /* [6] parameters of the torque function */
  double operating_depth_mm;
  double operating_force_kn;
} fsw_nmpc_model;

typedef struct { /* per call */
  double x[5];                 /* creep, slow, fast, thermal depth; temperature (model part) */
  const double *history;       /* [2 * n_history] power left, right; oldest first */
  double force_kn, speed_rpm;  /* inputs applied during the last interval */
  double force_offset_kn;      /* input disturbance */
  double torque_scale;         /* multiplies the process torque */
  double depth_offset_mm;      /* added to the depth shown, not to the contact */
  double temp_offset_c;        /* added to the temperature shown */
  const double *depth_low, *depth_high; /* [n_out] dead-band around the corridor */
  const double *temp_low, *temp_high;
  const double *depth_weight, *temp_weight; /* [n_out] L1 weights, > 0 or 0 for a row left out */
  const double *depth_square, *temp_square; /* [n_out] quadratic weights on the deviation from the band's centre */
  double move_weight[2];       /* L1 on moves, per kN and per rpm */
  double move_square[2];       /* quadratic on moves, per kN^2 and per rpm^2 */
  double move_max[2];
  double input_min[2], input_max[2];
  int max_iterations;
  double tolerance;            /* on the complementarity gap, relative to 1 + |cost| */
} fsw_nmpc_call;

typedef struct {
  int status;                  /* 0 solved, 1 iteration cap, 2 not finite or not positive definite */
  int iterations;
  double gap, primal_residual, dual_residual, cost;
} fsw_nmpc_result;

int fsw_nmpc_workspace_bytes(void);

/* Digest of the sources that this was made from, as given by the build. */
const char *fsw_nmpc_id(void);

/* Predict along the moves v [2 * n_blocks]; fills the outputs [n_out] and, when by_depth is not NULL, the sensitivities
 * [n_out * 2 * n_blocks], row by row. Returns 0, or 2 when something is not finite. */
int fsw_nmpc_predict(const fsw_nmpc_model *m, const fsw_nmpc_call *c, const double *v, double *depth, double *temp,
                     double *by_depth, double *by_temp, void *workspace);

/* One real-time iteration about the moves in v, which are replaced by the solution. */
int fsw_nmpc_solve(const fsw_nmpc_model *m, const fsw_nmpc_call *c, double *v, double *depth, double *temp,
                   fsw_nmpc_result *result, void *workspace);

#endif
