/* The complete NMPC of depth and temperature: estimator, reference trajectories, optimal control
 * problem, solver, acceptance, fallback and limits.
 *
 * Portable C99: no heap, no globals, no recursion, only sqrt, fabs, fmin and fmax of libm, and
 * every loop is bounded. All memory is in struct fsw_nmpc. All sizes of a model are checked. NaN,
 * missing and late samples are valid inputs.
 *
 * Units: mm, degC, kN, rpm, kW, N m, s. Moves: v[2 b] is the force move (kN per interval) and
 * v[2 b + 1] the speed move (rpm per interval) of block b; within a block the input changes by the
 * same move in every interval. In arrays of two outputs or inputs the first is depth or force, the
 * second temperature or speed. */
#ifndef FSW_NMPC_H
#define FSW_NMPC_H

#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__) || defined(_M_FP_FAST)
#error "NaN is an argument of this library: compile without -ffast-math, -Ofast, /fp:fast"
#endif
#ifdef __cplusplus
extern "C" {
#endif

/* Sizes, which a build may reduce to those of its model. */
#ifndef FSW_MAX_BLOCKS
#define FSW_MAX_BLOCKS 54
#endif
#ifndef FSW_MAX_STEPS
#define FSW_MAX_STEPS 80               /* model steps of the horizon */
#endif
#ifndef FSW_MAX_OUT
#define FSW_MAX_OUT 54                 /* output points, one per interval */
#endif
#ifndef FSW_MAX_HISTORY
#define FSW_MAX_HISTORY 100            /* ticks of dead time */
#endif
#define FSW_TICK_S 0.1
enum {
  FSW_MAX_VARS = 2 * FSW_MAX_BLOCKS,
  FSW_LATEST = 20,                     /* ticks by which a drive may lag */
  FSW_MAX_CHANGES = 8,                 /* known future set-points */
  FSW_MODES = 10,
  FSW_STATES = 13,
  FSW_ESTIMATES = 8                    /* of fsw_nmpc_output */
};

/* The model: constant tables. */
typedef struct {
  int n_steps;             /* model steps: one or more per interval; the first is one tick */
  int n_out;               /* output points = intervals */
  int n_blocks;            /* blocks of moves */
  int n_history;           /* power segments before now, one per tick */
  int n_weights;           /* entries of weight */
  const int *step_interval; /* [n_steps] interval of each step */
  const int *interval_block; /* [n_out] block of each interval, rising */
  const double *interval_ticks;/* [n_out] length of each interval */
  const double *block_reach; /* [n_blocks] largest move per interval, in moves of a tick */
  const int *out_step;     /* [n_out] the step whose end is the output point */
  const int *depth_width;  /* [n_out] number of leading variables that affect the depth there */
  const int *temperature_width;   /* [n_out] the same for the temperature */
  const double *time_s;    /* [n_out] */
  /* [n_steps * FSW_MODES] gain of creep; decay and gain of the slow mode; decay of the motor
   * torque and its lag over the step's length; copper and tool: cc, tc, tt, heat offset gains */
  const double *modes;
  const int *weight_start; /* [n_steps + 1] first delayed-power weight of each step */
  const int *weight_segment; /* power segment, history first */
  const double *weight;    /* 6 per entry: copper, then tool, by the 3 coefficients of the power */
  const double *ahead_power; /* [2 * 3 n_history] copper, tool after the dead time, by power */
  const double *torque_par; /* [6] parameters of the torque function */
  double ahead_mode[FSW_MODES];/* as modes, for one step over the dead time; from here on only doubles */
  double friction[3];      /* (23) */
  double depth_gain[2];    /* of creep and slow, mm/(kN s) */
  double slow_pole;        /* 1/s */
  double fast_gain;        /* gain of the settled fast mode, mm/kN */
  double softening_per_c;
  double thermal_gain_c_per_kw, copper_lag_s, tool_lag_s, dead_time_s;
  double inertia_nm_s_per_rpm; /* apparent torque while the speed changes */
  double operating_force_kn, operating_depth_mm, operating_temperature_c, operating_power_kw;
} fsw_nmpc_model;

/* The tuning: reference trajectories, cost, limits, estimator. Choices are indices of
 * enumerations. */
#include "fsw_nmpc_tuning.h"

/* States of the estimator; copper and tool are deviations from the operating temperature. */
typedef enum {
  FSW_CREEP, FSW_SLOW, FSW_COPPER, FSW_TOOL, FSW_MOTOR,
  FSW_FORCE, FSW_HEAT, FSW_SCALE, FSW_DEPTH_OFFSET, FSW_TEMP_OFFSET,
  FSW_DEPTH_RATE, FSW_TEMP_RATE,             /* of the offsets, per s */
  FSW_DEPTH_GAIN                             /* factor on the model's */
} fsw_state;

/* a set-point that takes effect at_s from now */
typedef struct { double at_s, depth_mm, temperature_c; } fsw_change;

typedef struct {
  double depth_mm, torque_nm, temperature_c;
  int depth_fresh, torque_fresh, temperature_fresh; /* whether it is a good sample of this tick */
  double force_kn, speed_rpm;                    /* acting inputs by the drives; NaN: unknown */
  double applied_force_kn, applied_speed_rpm;    /* command in force until now; NaN: unchanged */
  double reference_depth_mm, reference_temperature_c; /* NaN: unchanged */
  double dt_s;                                   /* since the last tick; <= 0 counts as one tick */
  int n_changes;
  fsw_change change[FSW_MAX_CHANGES];               /* in order of time */
  /* Heat that is known beforehand, as differences, so that all of it may come and go: how much more of it there was over
   * the tick that just ended than over the one before, and will be over each step of the horizon. 0: nothing is known. */
  double known_rise_kw, known_ahead_kw[FSW_MAX_STEPS];
  double known_deviation_kw;                        /* standard deviation of the rise */
} fsw_nmpc_input;

typedef enum {
  FSW_OK,
  FSW_ITERATION_CAP,
  FSW_NOT_FINITE,
  FSW_TOO_FAST,                            /* the solution exceeds a rate limit */
  FSW_OUTSIDE_BOUNDS,                      /* the solution leaves the bounds */
  FSW_NOT_SOLVED                           /* there was no problem to solve */
} fsw_solve_status;

/* Reason for the present proposal. */
typedef enum {
  FSW_PROPOSING,
  FSW_WAITING_FOR_SENSORS,
  FSW_WAITING_FOR_REFERENCE,
  FSW_SOLVER_FAILED,
  FSW_BLIND,
  FSW_OUT_OF_BOUNDS
} fsw_reason;

typedef enum { FSW_NO_DEPTH = 1, FSW_NO_TORQUE = 2, FSW_NO_TEMPERATURE = 4 } fsw_missing;

typedef struct {
  double force_kn, speed_rpm;           /* the proposal */
  int healthy, reason;
  int blind;                            /* bits of fsw_missing */
  int solve_status, iterations, bad_cycles, bad_in_a_row;
  double gap, primal_residual, dual_residual, cost;
  double depth_mm, temperature_c, torque_nm; /* estimated sensor values */
  double copper_c;                      /* estimated copper temperature */
  double attainable[2];                 /* set-points, or replacements within the inputs' bounds */
  /* estimates and their standard deviations: force, heat, torque scale, offsets of depth and
   * temperature, their rates, factor on the gain of the depth */
  double disturbance[FSW_ESTIMATES], deviation[FSW_ESTIMATES];
  int has_plan;
  double plan_depth_mm[FSW_MAX_OUT], plan_temperature_c[FSW_MAX_OUT];
  double plan_force_kn[FSW_MAX_OUT], plan_speed_rpm[FSW_MAX_OUT];
} fsw_nmpc_output;

/* Start of a prediction. */
typedef struct {
  double x[FSW_STATES];               /* the estimator's; in FSW_FORCE with what the drive is off by */
  double history[3 * FSW_MAX_HISTORY]; /* power P0, P1, P2 per tick (predict.c), oldest first */
  double force_kn, speed_rpm;         /* inputs until now */
  double speed_offset_rpm;
  double drift[2][FSW_MAX_OUT];            /* how far the two offsets move until each output point */
  double heat_ahead_kw[FSW_MAX_STEPS];     /* known heat over each step, beyond that of the state */
} fsw_start;

/* Problem of one tick: start, dead-bands about the trajectories. */
typedef struct {
  fsw_start start;
  double low[2][FSW_MAX_OUT], high[2][FSW_MAX_OUT];
} fsw_problem;

typedef struct {
  double x[FSW_STATES], p[FSW_STATES][FSW_STATES], a[FSW_STATES][FSW_STATES];
  double history[3 * FSW_MAX_HISTORY];
  double acting_force_kn, acting_speed_rpm;
  double command[2][FSW_LATEST];     /* commands of the last ticks, newest first */
  double offset[2];                  /* drive feedback minus command */
  double blind_s[3];
  int started;
  int is_excited;                          /* whether the force has moved lately */
  double recent;                           /* fading sum of the depth's innovations, each in its deviation */
  double innovation[3], expected[3];       /* of the last tick: innovation and its variance; 0 where there was none */
  double known_weight;                     /* share of the known heat that is used, see known_heat.c */
  double known_evidence;                   /* for it: fading logarithm of the likelihoods' ratio */
  /* what the known heat would do to the states if all of it were used, and what the share in use does; both
   * to the last measurement's expectation */
  double by_known[2][FSW_STATES], shown[2];
} fsw_estimator;

typedef struct {
  double moves[FSW_MAX_VARS];            /* the last accepted moves, shifted to the present tick */
  double start[FSW_MAX_VARS];            /* start of the next solve */
  double output[2][FSW_MAX_OUT];         /* their predicted outputs */
  int is_cold, has_outputs;
} fsw_plan;

#include "fsw_workspace.h"

typedef struct {
  fsw_nmpc_model model;
  fsw_nmpc_tuning tuning;
  fsw_estimator estimator;
  fsw_plan plan;
  fsw_problem problem;
  double corridor[2], rate[2];             /* of the last tick's trajectories */
  int has_corridor, has_rate, has_reference;
  double applied[2], reference[2], attainable[2], late_s;
  double unclipped[2];                     /* applied inputs before clipping to the bounds */
  int bad_in_a_row, bad_cycles;
  fsw_workspace workspace;
} fsw_nmpc;

/* Digest of the sources, as passed in by the build. */
const char *fsw_nmpc_id(void);

/* Take a model and a tuning; the model's tables must outlive the controller. Returns 0, or 1 if a
 * size or an index exceeds the compiled ones, a table is missing or not finite, or the tuning is
 * invalid: the controller must not be used then. Call it before any other function. */
int fsw_nmpc_init(fsw_nmpc *c, const fsw_nmpc_model *model, const fsw_nmpc_tuning *tuning);

/* Change the tuning; estimate and plan are kept. Returns 0, or 1 if a value is not finite or out
 * of range: the old tuning then stays. */
int fsw_nmpc_configure(fsw_nmpc *c, const fsw_nmpc_tuning *tuning);

/* Forget the past; the next step starts from these inputs, or from the last applied ones if they
 * are not finite. */
void fsw_nmpc_reset(fsw_nmpc *c, double force_kn, double speed_rpm);

/* Clear an input: no sample, NaN, one tick since the last. */
void fsw_nmpc_input_clear(fsw_nmpc_input *in);

/* One tick; call it every FSW_TICK_S, as the largest moves are per call. Whatever the input, the
 * proposal is within the bounds and within one move of the applied command; if both are
 * impossible, it is the nearest bound and not healthy. */
void fsw_nmpc_step(fsw_nmpc *c, const fsw_nmpc_input *in, fsw_nmpc_output *out);

/* The same in two halves, for another solver in between: begin returns whether there is a problem
 * to solve (in c->problem, to be started from c->plan.start); end takes the solution. */
int fsw_nmpc_begin(fsw_nmpc *c, const fsw_nmpc_input *in, fsw_nmpc_output *out);
void fsw_nmpc_end(fsw_nmpc *c, const double *moves, const double *depth, const double *temp, int status,
                  fsw_nmpc_output *out);

/* Random walk of each state per tick. */
void fsw_estimator_walk(const fsw_estimator_tuning *t, double walk[FSW_STATES]);

/* Depth that the tool feels, (27), and, unless row is NULL, its derivative by the states. */
double fsw_contact_depth(const fsw_estimator *e, const fsw_nmpc_model *m, double row[FSW_STATES]);

/* Predict along the moves v [2 n_blocks]: outputs into w->output, and their sensitivities into as much
 * of w->by as the model's widths say. Returns FSW_OK, or FSW_NOT_FINITE. */
int fsw_predict(const fsw_nmpc_model *m, const fsw_start *start, const double *v, fsw_workspace *w);

/* One real-time iteration about the moves in v, which receive the solution. The problem's inputs start within the bounds. */
int fsw_solve(fsw_nmpc *c, const fsw_problem *problem, double *v, double *depth, double *temp, fsw_nmpc_output *out);

#ifdef __cplusplus
}
#endif
#endif
