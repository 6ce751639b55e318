/* The decentralized controller of depth and temperature: temperature by spindle speed through a power loop, depth by axial
 * force. Two single loops side by side; on request with a Smith predictor and a decoupling of the speed from the force.
 *
 * Portable C99: no heap, no globals, no recursion, of libm only exp, no unbounded iteration. All memory is the struct fsw_decentral,
 * which holds no pointer and may be copied. NaN, stale and missing samples are arguments. Arithmetic is that of IEEE 754,
 * in double precision.
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

#define FSW_DECENTRAL_TICK_S 0.1             /* counts as the time since the last tick where that is not usable */
#define FSW_DECENTRAL_LONGEST_DEAD_TIME_S 10.0
#define FSW_DECENTRAL_HISTORY 102            /* samples for the longest dead time, and two to interpolate */

/* Gains, limits and what is known of the spindle. */
typedef struct {
  double depth_gain;                         /* kN/mm */
  double depth_integral_time, depth_derivative_time, depth_filter;
  double depth_weight;                       /* of the set-point in the proportional part */
  double depth_reference_filter, depth_tracking_time;
  double temperature_gain;                   /* kW/degC */
  double temperature_integral_time, temperature_derivative_time, temperature_filter;
  double temperature_weight;
  double temperature_reference_filter, temperature_tracking_time;
  double power_gain;                         /* rpm/kW */
  double power_integral_time, power_filter, power_tracking_time;
  double feedforward_filter;                 /* times and time constants: s */
  double decoupling_torque, decoupling_lag;  /* process torque of the force, N m/kN, and how late it comes; 0: none */
  double predictor_gain;                     /* temperature over power, degC/kW */
  double predictor_copper_lag, predictor_tool_lag;
  double predictor_dead_time;                /* 0: no predictor */
  double force_min_kn, force_max_kn, speed_min_rpm, speed_max_rpm;
  double force_step_kn, speed_step_rpm;      /* largest change per tick */
  double friction[3];                        /* (23): N m, N m/rpm, N m/rpm^2 */
  double spindle_inertia_kgm2;               /* as seen in the motor torque while the spindle accelerates */
  double nominal_torque_nm;                  /* process torque until the first valid sample */
  double blind_limit_s;                      /* longest time without torque or temperature that stays healthy */
} fsw_decentral_tuning;

typedef struct {
  double depth_mm, torque_nm, temperature_c;
  int depth_valid, torque_valid, temperature_valid; /* whether it may be used; the last good value for a while, too */
  double applied_force_kn, applied_speed_rpm;       /* command in force until now */
  double reference_depth_mm, reference_temperature_c;
  double dt_s;                                      /* since the last tick; above 0, counts as 1 at most */
} fsw_decentral_input;

/* Why a proposal is not healthy. */
typedef enum {
  FSW_DECENTRAL_PROPOSING,
  FSW_DECENTRAL_NO_DEPTH,                    /* force held */
  FSW_DECENTRAL_NO_TORQUE,                   /* for longer than blind_limit_s */
  FSW_DECENTRAL_NO_TEMPERATURE,              /* likewise */
  FSW_DECENTRAL_OVERFLOW,                    /* samples beyond all range: the loops start again */
  FSW_DECENTRAL_OUT_OF_BOUNDS                /* what is applied is more than a step outside the bounds */
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
  int active_limits;                         /* 0 if the proposal is as the loops have it */
  int bad_cycles;                            /* unhealthy proposals since the start */
  double depth_mm, temperature_c, torque_nm; /* filtered: depth, temperature, process torque; NaN before the first sample */
} fsw_decentral_output;

/* PID, derivative on the measurement; the set-point is filtered and weighted. The measurement passes two equal first-order
 * filters in series: behind one alone the derivative would pass on too much noise. */
typedef struct {
  int started;
  double first_stage, measured;              /* behind the first filter, behind both */
  double reference, output, integrator;      /* in absolute values: the integrator holds the operating point */
  double gain, weight, integral, derivative; /* per tick */
  double filter, reference_filter, tracking; /* shares taken over in a tick */
} fsw_decentral_loop;

/* Speed from a power reference: feed-forward by the measured torque, and PI on the measured power. */
typedef struct {
  int started;
  double now_nm, fast_nm, slow_nm;           /* process torque: as measured, for the power, for the feed-forward */
  double caused_kn, seen_kn;                 /* force behind the torque at the end of this tick, and behind slow_nm */
  double output, integrator, gained;         /* gained: by the integrator in the last tick */
  double gain, integral, filter, feedforward, tracking, decoupling_nm_per_kn, decoupling;
} fsw_decentral_power;

/* Smith predictor: by how much the linear model of power to temperature is ahead of itself one dead time ago. */
typedef struct {
  int started, newest;
  double copper_kw, tool_kw;                 /* power behind the first lag and behind both */
  double past_kw[FSW_DECENTRAL_HISTORY];     /* of tool_kw, one a tick, in a ring */
  double correction_c;
  double gain, copper, tool, delay_ticks;    /* lags as shares taken over in a tick */
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

int fsw_decentral_bytes(void);

/* Digest of the sources that this was made from, as given by the build. */
const char *fsw_decentral_id(void);

/* Whether a tuning can be used: all finite; gains, times, steps, inertia and blind limit not negative; integral and
 * tracking times and the nominal torque above 0; minima below maxima; the dead time not above the longest one. */
int fsw_decentral_is_usable(const fsw_decentral_tuning *tuning);

/* Take a tuning and start from the middle of its bounds. Returns 0, or 1 when the tuning is not usable: the controller
 * must not be used then. No other function may be called before. */
int fsw_decentral_init(fsw_decentral *c, const fsw_decentral_tuning *tuning);

/* Another tuning; the proposals do not jump. Returns 0, or 1 when it is not usable: then the last one stays. */
int fsw_decentral_configure(fsw_decentral *c, const fsw_decentral_tuning *tuning);

/* Forget the past; the next step starts from these inputs, or from the last proposal if one of them is not finite. */
void fsw_decentral_reset(fsw_decentral *c, double force_kn, double speed_rpm);

/* An input of which nothing is known: no sample, NaN, one tick since the last. */
void fsw_decentral_input_clear(fsw_decentral_input *in);

/* One tick, to be called once every FSW_DECENTRAL_TICK_S: the largest moves are per call. The proposal is always within the
 * bounds, and within one step of the applied command, or of the last proposal where that is not finite. Where both cannot
 * be, it is the nearest bound and not healthy. */
void fsw_decentral_step(fsw_decentral *c, const fsw_decentral_input *in, fsw_decentral_output *out);

#ifdef __cplusplus
}
#endif
#endif
