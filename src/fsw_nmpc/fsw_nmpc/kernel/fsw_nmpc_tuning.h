/* Generated from the models in fsw_nmpc/tuning.py by fsw_nmpc/kernel_codegen.py; do not edit. */
#ifndef FSW_NMPC_TUNING_H
#define FSW_NMPC_TUNING_H

typedef enum { FSW_APPROACH, FSW_CONSTANT, FSW_COLD_START, FSW_RECENTRED, FSW_RECENTRED_AHEAD } fsw_trajectory;

typedef enum { FSW_KEEP_DEPTH, FSW_KEEP_BALANCE, FSW_KEEP_TEMPERATURE } fsw_priority;

typedef struct {
  /* second, faster time constant of the depth: the force needs some ticks */
  double force_time_s;
  /* second, faster time constant of the temperature: the power needs some ticks */
  double power_time_s;
  /* acceleration of the depth relative to what the speed can compensate; more would disturb the
   * temperature */
  double depth_acceleration;
  /* usable share of the acceleration when braking */
  double brake_share;
  /* usable share of the temperature's maximum rate */
  double rate_share;
  /* share of the last tick's planned depth rate that is kept, to smooth noise */
  double depth_approach_keep;
  /* share of the last tick's planned temperature rate that is kept, to smooth noise */
  double temperature_approach_keep;
  /* lower bound of the usable force, on either side of the holding force */
  double least_force_kn;
  /* lower bound of the usable temperature rate */
  double least_rate_c_per_s;
  /* lower bound of the holding power */
  double least_power_kw;
  /* longest time by which an approach begins before a known future set-point */
  double longest_lead_s;
  /* uncertainty of the estimated heat: a temperature beyond reach is sought with so much more
   * power than a bound of the speed gives, so that noise does not move the speed from its bound */
  double beyond_bound_kw;
} fsw_approach_tuning;

typedef struct {
  double depth_noise_mm;
  double torque_noise_nm;
  double temperature_noise_c;
  double creep_walk_mm;
  double copper_walk_c;
  double motor_walk_nm;
  double force_walk_kn;
  double heat_walk_kw;
  double torque_scale_walk;
  double depth_offset_walk_mm;
  double temperature_offset_walk_c;
  /* of the rate of the depth offset; 0: constant */
  double depth_rate_walk_mm_per_s;
  /* of the rate of the temperature offset; 0: constant */
  double temperature_rate_walk_c_per_s;
  /* of the factor on the model's gain from force to depth; 0: it stays 1 */
  double depth_gain_walk;
  /* an innovation of more standard deviations is a jump; 0: never */
  double jump_sigmas;
  /* depth innovations are a drift if their sum over about a second exceeds this; 0: never */
  double drift_sigmas;
  /* standard deviations at the start, in the order of fsw_state: creep, slow, copper, tool, motor,
   * force, heat, torque scale, offsets, their rates, depth gain */
  double start_deviation[FSW_STATES];
  /* lower bound of the factor on the process torque */
  double torque_scale_min;
  /* upper bound of the factor on the process torque */
  double torque_scale_max;
  /* lower bound of the factor on the depth gain */
  double depth_gain_min;
  /* upper bound of the factor on the depth gain */
  double depth_gain_max;
  /* depths above this are implausible */
  double depth_max_mm;
  /* larger deviations from the operating temperature are implausible */
  double temperature_deviation_max_c;
  /* larger disturbance forces are implausible */
  double force_offset_max_kn;
  /* torque samples beyond this factor from the expectation are rejected */
  double torque_outlier_factor;
  /* lower bound of the torque that scales a jump of the torque factor */
  double torque_min_nm;
  /* share of the inertia peak that counts as noise: the drive's lag spreads it over two ticks */
  double torque_peak_noise_share;
  /* share of a depth jump's variance given to the sensor offset; the true depth gets the rest */
  double jump_offset_share;
  /* decay per tick of the sum of depth innovations: a memory of about a second */
  double drift_keep;
  /* the depth gain is estimated while the force has moved by more within two seconds */
  double excitation_force_kn;
  /* share of the evidence for the known heat left after a tick: it covers about a minute */
  double known_heat_keep;
  /* logarithm of the likelihood ratio against the known heat at which none of it is used; as much
   * counts for it at most */
  double known_heat_evidence;
  /* no more is counted against the known heat, so that it can be used again */
  double known_heat_counter_evidence;
  /* largest random walk of what the known heat lacks, however uncertain: more would cost the loop
   * its margin */
  double known_heat_walk_kw;
  /* standard deviation of the heat at the start of a weld whose heat is known: there the process
   * warms, and is not at rest */
  double known_heat_start_kw;
  /* largest change per tick of the share of the known heat in use */
  double known_heat_step;
  /* Decay per tick of the two sensor offsets. */
  double offset_keep;
  /* Decay per tick of the rate of the depth offset. */
  double depth_rate_keep;
  /* Decay per tick of the rate of the temperature offset. */
  double temperature_rate_keep;
} fsw_estimator_tuning;

typedef struct {
  /* time constant of the approach near the set-point, or of the corridor (tau_t, paper (32)) */
  double depth_time_s;
  /* time constant of the approach near the set-point, or of the corridor (tau_t, paper (32)) */
  double temperature_time_s;
  /* half width of the dead-band about the trajectory */
  double dead_band_depth_mm;
  /* half width of the dead-band about the trajectory */
  double dead_band_temperature_c;
  /* largest depth error that an approach accepts in favour of the temperature */
  double quality_depth_mm;
  /* below it an approach lets the depth give way, whatever the priority */
  double quality_temperature_min_c;
  /* above it an approach lets the depth give way, whatever the priority */
  double quality_temperature_max_c;
  /* L1 weight outside the dead-band, per output point */
  double weight_depth_per_mm;
  /* L1 weight outside the dead-band, per output point */
  double weight_temperature_per_c;
  /* quadratic cost per output point: a deviation of this size costs 1/2; 0: none */
  double depth_scale_mm;
  /* quadratic cost per output point: a deviation of this size costs 1/2; 0: none */
  double temperature_scale_c;
  /* L1 weight on the moves of an interval */
  double move_force_per_kn;
  /* L1 weight on the moves of an interval */
  double move_speed_per_rpm;
  /* quadratic cost of an interval's move, twice that of the largest move, for both inputs */
  double full_move_cost;
  /* the problem is solved again about its solution if the first move is further from the expected
   * one, in largest moves */
  double second_solve_distance;
  /* of the solver: complementarity gap relative to 1 + |cost| */
  double tolerance;
  fsw_approach_tuning approach;
  fsw_estimator_tuning estimator;
  /* Decay per tick of the depth corridor's distance to the set-point. */
  double depth_corridor_keep;
  /* Decay per tick of the temperature corridor's distance to the set-point. */
  double temperature_corridor_keep;
  double force_min_kn;
  double force_max_kn;
  double speed_min_rpm;
  double speed_max_rpm;
  double force_step_kn;
  double speed_step_rpm;
  double blind_limit_s;
  /* reference trajectory: approach, constant, cold_start, recentred or recentred_ahead */
  int trajectory;
  /* most iterations of the first solve after which it is solved again: after more, the second
   * solve could exceed the tick */
  int second_solve_iterations;
  int priority;
  int max_iterations;
  int plan_reuse;
} fsw_nmpc_tuning;

#define FSW_EACH_SHARE(DO) \
  DO(approach.brake_share) DO(approach.rate_share) DO(approach.depth_approach_keep) \
  DO(approach.temperature_approach_keep) DO(estimator.torque_peak_noise_share) \
  DO(estimator.jump_offset_share) DO(estimator.known_heat_keep) DO(estimator.offset_keep) \
  DO(estimator.depth_rate_keep) DO(estimator.temperature_rate_keep) DO(depth_corridor_keep) \
  DO(temperature_corridor_keep)

#endif
