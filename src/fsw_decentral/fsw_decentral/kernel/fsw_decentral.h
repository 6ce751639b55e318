/* The decentralized controller of depth and temperature: temperature by spindle speed through a
 * power loop, depth by axial force. Two single loops side by side; optionally with a Smith
 * predictor and a decoupling of the speed from the force.
 *
 * Portable C99: no heap, no globals, no recursion, only exp of libm, bounded iteration. All memory
 * is in struct fsw_decentral, which holds no pointer and may be copied. NaN, stale and missing
 * samples are valid inputs. IEEE 754 arithmetic in double precision.
 *
 * Units: mm, degC, kN, rpm, kW, N m, s. */
#ifndef FSW_DECENTRAL_H
#define FSW_DECENTRAL_H

#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__) || defined(_M_FP_FAST)
#error "NaN is an argument of this library: compile without -ffast-math, -Ofast, /fp:fast"
#endif
#ifdef __cplusplus
extern "C" {
#endif

#define FSW_DECENTRAL_TICK_S 0.1        /* default of the time since the last tick */
#define FSW_DECENTRAL_LONGEST_DEAD_TIME_S 10.0
#define FSW_DECENTRAL_HISTORY 102       /* samples for the longest dead time, plus interpolation */

/* Gains, limits and data of the spindle. */
typedef struct {
  double depth_gain;                       /* kN/mm */
  double depth_integral_time, depth_derivative_time, depth_filter;
  double depth_weight;                     /* of the set-point in the proportional part */
  double depth_reference_filter, depth_tracking_time;
  double temperature_gain;                 /* kW/degC */
  double temperature_integral_time, temperature_derivative_time, temperature_filter;
  double temperature_weight;
  double temperature_reference_filter, temperature_tracking_time;
  double power_gain;                       /* rpm/kW */
  double power_integral_time, power_filter, power_tracking_time;
  double feedforward_filter;               /* times and time constants: s */
  double decoupling_torque, decoupling_lag; /* torque by force, N m/kN, and its lag; 0: off */
  double predictor_gain;                   /* temperature over power, degC/kW */
  double predictor_copper_lag, predictor_tool_lag;
  double predictor_dead_time;              /* 0: no predictor */
  double force_min_kn, force_max_kn, speed_min_rpm, speed_max_rpm;
  double force_step_kn, speed_step_rpm;    /* largest change per tick */
  double friction[3];                      /* (23): N m, N m/rpm, N m/rpm^2 */
  double spindle_inertia_kgm2;             /* apparent in the motor torque at acceleration */
  double nominal_torque_nm;                /* process torque until the first valid sample */
  double blind_limit_s;                    /* longest healthy time without torque or temperature */
} fsw_decentral_tuning;

typedef struct {
  double depth_mm, torque_nm, temperature_c;
  int depth_valid, torque_valid, temperature_valid; /* whether usable, including held values */
  double applied_force_kn, applied_speed_rpm;       /* command in force until now */
  double reference_depth_mm, reference_temperature_c;
  double dt_s;                                      /* since the last tick; above 0, at most 1 */
} fsw_decentral_input;

/* Reasons for an unhealthy proposal. */
typedef enum {
  FSW_DECENTRAL_PROPOSING,
  FSW_DECENTRAL_NO_DEPTH,                    /* force held */
  FSW_DECENTRAL_NO_TORQUE,                   /* for longer than blind_limit_s */
  FSW_DECENTRAL_NO_TEMPERATURE,              /* for longer than blind_limit_s */
  FSW_DECENTRAL_OVERFLOW,                    /* samples beyond all range: the loops restart */
  FSW_DECENTRAL_OUT_OF_BOUNDS                /* the applied command is more than a step outside */
} fsw_decentral_reason;

/* Limits that a proposal touches, as bits. */
typedef enum {
  FSW_DECENTRAL_FORCE_MIN = 1,
  FSW_DECENTRAL_FORCE_MAX = 2,
  FSW_DECENTRAL_SPEED_MIN = 4,
  FSW_DECENTRAL_SPEED_MAX = 8,
  FSW_DECENTRAL_FORCE_RATE = 16,
  FSW_DECENTRAL_SPEED_RATE = 32
} fsw_decentral_limit;

typedef struct {
  double force_kn, speed_rpm;                /* the proposal */
  int healthy, reason;
  int active_limits;                         /* 0 if no limit has changed the proposal */
  int bad_cycles;                            /* unhealthy proposals since the start */
  double depth_mm, temperature_c, torque_nm; /* filtered values; NaN before the first sample */
} fsw_decentral_output;

/* PID with the derivative on the measurement; the set-point is filtered and weighted. The
 * measurement passes two equal first-order filters: after a single one the derivative would be too
 * noisy. */
typedef struct {
  int started;
  double first_stage, measured;            /* after the first filter, after both */
  double reference, output, integrator;    /* absolute: the integrator holds the operating point */
  double gain, weight, integral, derivative; /* per tick */
  double filter, reference_filter, tracking; /* shares per tick */
} fsw_decentral_loop;

/* Speed for a power reference: feedforward by the measured torque, plus PI on measured power. */
typedef struct {
  int started;
  double now_nm, fast_nm, slow_nm;           /* torque: as measured, for power, for feedforward */
  double caused_kn, seen_kn;                 /* force in the torque after this tick, in slow_nm */
  double output, integrator, gained;         /* gained: integrator's last increment */
  double gain, integral, filter, feedforward, tracking, decoupling_nm_per_kn, decoupling;
} fsw_decentral_power;

/* Smith predictor: difference of the linear model (16) with and without its dead time. */
typedef struct {
  int started, newest;
  double copper_kw, tool_kw;                 /* power after the first lag and after both */
  double past_kw[FSW_DECENTRAL_HISTORY];     /* ring buffer of tool_kw, one per tick */
  double correction_c;
  double gain, copper, tool, delay_ticks;    /* lags as shares per tick */
} fsw_decentral_predictor;

typedef struct {
  fsw_decentral_tuning tuning;
  fsw_decentral_loop depth, temperature;
  fsw_decentral_power power;
  fsw_decentral_predictor predictor;
  double dt_s, proposed_force_kn, proposed_speed_rpm, speed_before_rpm;
  double reference_depth_mm, reference_temperature_c;
  double blind_torque_s, blind_temperature_s;
  int bad_cycles;
} fsw_decentral;

/* Digest of the sources, as passed in by the build. */
const char *fsw_decentral_id(void);

/* Whether a tuning is valid: all finite; gains, times, steps, inertia and blind limit not
 * negative; integral and tracking times and the nominal torque above 0; minima below maxima; the
 * dead time not above the longest one. */
int fsw_decentral_is_usable(const fsw_decentral_tuning *tuning);

/* Take a tuning and start from the middle of its bounds. Returns 0, or 1 if the tuning is invalid:
 * the controller must not be used then. Call it before any other function. */
int fsw_decentral_init(fsw_decentral *c, const fsw_decentral_tuning *tuning);

/* Change the tuning bumplessly. Returns 0, or 1 if it is invalid: the last one then stays. */
int fsw_decentral_configure(fsw_decentral *c, const fsw_decentral_tuning *tuning);

/* Forget the past; the next step starts from these inputs, or from the last proposal if one of
 * them is not finite. */
void fsw_decentral_reset(fsw_decentral *c, double force_kn, double speed_rpm);

/* Clear an input: no sample, NaN, one tick since the last. */
void fsw_decentral_input_clear(fsw_decentral_input *in);

/* One tick; call it every FSW_DECENTRAL_TICK_S, as the largest moves are per call. The proposal is
 * always within the bounds, and within one step of the applied command (of the last proposal if
 * that is not finite). If both are impossible, it is the nearest bound and not healthy. */
void fsw_decentral_step(fsw_decentral *c, const fsw_decentral_input *in, fsw_decentral_output *out);

#ifdef __cplusplus
}
#endif
#endif
