/* The plant: drives, the paper's process, disturbances and sensors, one tick of 0.1 s at a time.
 *
 * The emulator, batches of plants and the FMU all use it. Memory is the caller's; nothing is kept
 * elsewhere. Units: mm, degC, N m, kN, rpm, kW, s. Pairs are (force, speed). */
#ifndef FSW_PLANT_H
#define FSW_PLANT_H

#ifdef __cplusplus
extern "C" {
#endif

#define FSW_PLANT_STATES 6      /* STATE_NAMES in fsw_model/equations.py */
#define FSW_PLANT_POWER 4       /* N_POWER there */
#define FSW_PLANT_NUMBERS 75    /* numbers_of() there */
#define FSW_PLANT_DELAY 101     /* most steps of the process's dead time */
#define FSW_PLANT_DEAD_TICKS 10 /* most ticks of the drives' dead time */
#define FSW_PLANT_SENSORS 16    /* most sensors: rows of SENSORS in fsw_control/sensors.py */
#define FSW_PLANT_QUANTITIES 3  /* that sensors show: depth, torque, temperature */
#define FSW_PLANT_WAVES 12      /* harmonics of the copper's hardness around the canister */
#define FSW_PLANT_AMPLITUDES 300 /* most states of the heat in a canister */
#define FSW_PLANT_LONGEST_S 1800 /* longest heating before the first tick, chosen */

/* Why a start or a step is not possible: the process would leave its model; the tool would leave the
 * copper of the canister; heating takes too long. */
#define FSW_PLANT_LEFT 1
#define FSW_PLANT_OFF_COPPER 2
#define FSW_PLANT_COLD 3

/* A process: what its equations take of the parameters. */
typedef struct {
  double numbers[FSW_PLANT_NUMBERS];
  double force_kn, depth_mm, temperature_c, power_kw; /* operating point (15) */
  double gain_c_per_kw, softening_per_c; /* of (16) and (27) */
  double inertia_nm_s_per_rpm; /* peak of the measured torque over the acceleration of the spindle */
  double motor_risen;          /* share of an added torque that the motor shows after a step */
  double motor_mean;           /* and its mean over the step */
  double dead_steps;           /* dead time in steps */
  int delay_steps;             /* that the dead time spans */
} fsw_plant_model;

/* A drive: dead time, rate limit and first-order lag between command and actual value. */
typedef struct {
  double position, setpoint;
  double largest_step;                         /* of the set-point in a tick */
  double left, mean;                           /* of a deviation after a tick, and its mean over it */
  double band;                                 /* a command that is less away does not move it */
  double on_the_way[FSW_PLANT_DEAD_TICKS];     /* set-points, the oldest first */
  int dead_ticks;
} fsw_plant_drive;

/* The thermocouple's probe: a first-order lag behind the temperature about it; at once without one. */
typedef struct {
  double value_c, process_c, around_c;         /* around_c: process and disturbance at the last tick */
  double left, mean;                           /* of a deviation after a tick, and its mean over it */
  int is_slow;
} fsw_plant_probe;

/* What a sensor of the depth shows of the machine, in shares of fsw_plant_machine's lengths: 0 of an
 * ideal one. A sensor that rides on the copper is lead_mm ahead of the tool along its path. */
typedef struct {
  double deflection, tool, canister, swelling, runout;
  double edge_here, edge_ahead, lead_mm;       /* the surface at the tool, and below the sensor */
} fsw_plant_mount;

/* The machine and the copper in it; all 0: rigid, cold, even and nominal. */
typedef struct {
  double compliance_mm_per_kn, touch_off_kn;   /* deflection, none at the touch-off's force */
  double tool_mm_per_kw, tool_left;            /* growth in steady state, and what a tick leaves of the rest */
  double canister_mm_per_kw, canister_left;
  double runout_mm;                            /* of the spindle */
  double swelling_mm_per_mm, swelling_from_mm; /* of the copper beside the shoulder, by its depth */
  double edge_mm, edge_at_mm;                  /* the surface rises there, along the path */
  double traverse_mm_per_s, circumference_mm;
  double harder;                               /* of the canister, as a share of the nominal hardness */
  double wave[FSW_PLANT_WAVES], phase[FSW_PLANT_WAVES]; /* of the hardness along the path, by harmonic */
  /* state: */
  double travel_mm, turns, tool_mm, canister_mm;
  double harder_here, torque_more;             /* shares, during the present tick */
  double nominal_nm;                           /* torque of the tool in nominal copper */
} fsw_plant_machine;

/* Noise of a sensor, a first-order Gauss-Markov process, and its quantisation. */
typedef struct {
  int quantity;                                /* that it shows, by its index */
  fsw_plant_mount mount;
  double deviation, resolution;                /* 0: none */
  double kept;                                 /* share of the noise that is left after a tick */
  double noise;                                /* in standard deviations */
  int has_noise;
} fsw_plant_sensor;

/* A compact canister (fsw_plant/process.py): its tables, by rows. */
typedef struct {
  int states, even;                             /* those that are even about the tool come first */
  int positions, temperatures;
  double radius_mm, lowest_mm, highest_mm;      /* outer radius; range of the tool above the joint line */
  const double *decay, *transport;              /* (states, states); (even, states - even) */
  const double *axial_mm, *source, *rim, *rest; /* (positions); (positions, even) twice; (positions) */
  const double *theta_k, *grid_c;               /* Kirchhoff transform of temperatures */
} fsw_plant_canister;

/* The heat in a canister. Its arrays are the caller's. */
typedef struct {
  const fsw_plant_canister *canister;
  double *amplitude;                           /* (states), in the tool's frame */
  double *kept, *response;                     /* transition over a tick, see fsw_plant_canister_over */
  double *work;                                /* (3, states, states) */
  double traverse_mm_per_s;                    /* of that transition */
  int is_ready;                                /* it has been computed */
  double axial_mm;                             /* of the tool above the joint line, at the end of a tick */
  double copper[FSW_PLANT_DELAY + 1];          /* stir zone less operating temperature within the dead
                                                  time, the oldest first */
} fsw_plant_field;

typedef struct {
  double depth_mm, temperature_c, copper_temperature_c;
  double motor_torque_nm, process_torque_nm, friction_torque_nm, power_kw;
} fsw_plant_outputs;

/* What is added to the plant during a tick. */
typedef struct {
  double depth_mm, temperature_c, torque_nm, force_kn, speed_rpm, friction; /* share of the torque */
} fsw_plant_disturbance;

typedef struct {
  fsw_plant_drive drive[2];
  fsw_plant_probe probe;
  fsw_plant_machine machine;
  fsw_plant_sensor sensor[FSW_PLANT_SENSORS];
  int sensors;                                 /* that there are */
  double torque_drop_nm_per_rpm, nominal_rpm;  /* of the torque's measurement */
  double x[FSW_PLANT_STATES];
  double power[FSW_PLANT_DELAY][FSW_PLANT_POWER]; /* on its way through the dead time, a ring */
  int oldest;                                  /* its row that arrives */
  fsw_plant_outputs outputs;                   /* without disturbances and noise */
  double acting[2];                            /* as the drives report it: disturbances included */
  double inertia_nm;
  double left[3];                              /* depth, force and speed of a step that left the model */
  int stopped;                                 /* why the process stands still; 0: it runs */
  fsw_plant_field *field;                      /* on a canister; else NULL */
} fsw_plant;

/* During a tick: mean of force and speed, and their values at its end; disturbances included. In
 * nominal copper the mean force would be copper_kn, and added_nm less torque. */
typedef struct {
  double mean[2], end[2];
  double copper_kn, added_nm;
} fsw_plant_inputs;

/* One tick of a drive; returns its mean position. */
double fsw_plant_drive_advance(fsw_plant_drive *drive, double target);

/* Settings of the parts. A drive's set-points that are to come earlier now replace the older ones;
 * what a correlated noise is at stays. */
void fsw_plant_drive_configure(fsw_plant_drive *drive, double largest_step, double lag_s,
                               int dead_ticks);
void fsw_plant_probe_configure(fsw_plant_probe *probe, double lag_s);
void fsw_plant_machine_configure(fsw_plant_machine *machine, double tool_s, double canister_s);
void fsw_plant_sensor_configure(fsw_plant_sensor *sensor, double deviation, double resolution,
                                double correlation_s);

/* One tick of the probe, at whose end the process has this temperature; the disturbance is held. */
void fsw_plant_probe_advance(fsw_plant_probe *probe, double process_c);

/* A reading of a value, with a standard normal number. */
double fsw_plant_sensor_read(fsw_plant_sensor *sensor, double normal, double value);

/* All at rest in the paper's equilibrium of a depth and a temperature; settings of the parts stay.
 * Returns 1 if there is none: the power and the factor of (27) must be positive. */
int fsw_plant_start(fsw_plant *plant, const fsw_plant_model *model, double depth_mm,
                    double temperature_c);

/* The same with a state x, but for its motor torque, and the power that the spindle gives in it. */
void fsw_plant_begin(fsw_plant *plant, const fsw_plant_model *model, const double *x,
                     double power_kw);

/* On a canister, instead of fsw_plant_start: heats it by a constant power until the thermocouple
 * shows a temperature. Returns why there is no such start; left[0] is then what is missing [degC]. */
int fsw_plant_heat_up(fsw_plant *plant, const fsw_plant_model *model, double depth_mm,
                      double temperature_c, double power_kw);

/* Another process of another dead time: the newest history is kept, the oldest of it repeated. */
void fsw_plant_refit(fsw_plant *plant, int delay_before, int delay_steps);

/* The quantities at a tick, as ideal sensors show them: depth, torque, temperature. */
void fsw_plant_show(fsw_plant *plant, const fsw_plant_disturbance *disturbance, double *shown);

/* What the sensors measure, with a standard normal number for each; once a tick. */
void fsw_plant_measure(fsw_plant *plant, const fsw_plant_disturbance *disturbance,
                       const double *normal, double *shown);

/* One tick. Returns why the process stands still, since now or before; 0: it runs. */
int fsw_plant_step(fsw_plant *plant, const fsw_plant_model *model, const double *command,
                   const fsw_plant_disturbance *disturbance);

/* A canister's heat alone. Transition over a time at a speed of the tool, transposed: of the
 * amplitudes, (states, states), and by heat, (even, states); work is (3, states, states). */
void fsw_plant_canister_over(const fsw_plant_canister *canister, double traverse_mm_per_s,
                             double dt_s, double *kept, double *response, double *work);
void fsw_plant_canister_step(const fsw_plant_canister *canister, const double *kept,
                             const double *response, double power_kw, double axial_mm,
                             double *amplitude);
double fsw_plant_canister_stir_zone_c(const fsw_plant_canister *canister, const double *amplitude,
                                      double power_kw, double axial_mm);

/* The copper's temperature that the tool meets at both ends of the next step, a dead time late. */
void fsw_plant_meet(const fsw_plant_field *field, const fsw_plant_model *model, double *met);

void fsw_plant_outputs_of(const fsw_plant_model *model, const double *x, double force_kn,
                          double speed_rpm, fsw_plant_outputs *outputs);

/* Many plants of one process and as many sensors, each with its disturbance, numbers and command. */
void fsw_plant_measure_all(fsw_plant *plants, int n, const fsw_plant_disturbance *disturbances,
                           const double *normals, double *shown);
void fsw_plant_step_all(fsw_plant *plants, int n, const fsw_plant_model *model,
                        const double *commands, const fsw_plant_disturbance *disturbances);

/* Digest of the sources. */
const char *fsw_plant_id(void);

#ifdef __cplusplus
}
#endif

#endif
