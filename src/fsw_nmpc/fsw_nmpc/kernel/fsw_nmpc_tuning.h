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
  /* factor by which the depth may accelerate faster than the speed can hold the power; more would disturb the
   * temperature */
  double depth_acceleration;
  /* where the temperature gives way, share by which the depth accelerates faster still while it is twice its quality
   * limit from its set-point or further; less below, at that limit not at all, as a tool that jumps is to take no more
   * of the temperature */
  double haste;
  /* usable share of the acceleration when braking */
  double brake_share;
  /* usable share of the temperature's maximum rate */
  double rate_share;
  /* share of the last tick's planned rate of the depth that is kept, to smooth noise */
  double depth_approach_keep;
  /* share of the last tick's planned rate of the temperature that is kept, to smooth noise */
  double temperature_approach_keep;
  /* a plant that cannot move gets at least so much force about the force that holds */
  double least_force_kn;
  /* a plant that cannot heat gets at least this rate */
  double least_rate_c_per_s;
  /* smallest power that holds a temperature */
  double least_power_kw;
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
  /* of the rate of the depth's offset; 0: it does not move */
  double depth_rate_walk_mm_per_s;
  /* of the rate of the temperature's offset; 0: it does not move */
  double temperature_rate_walk_c_per_s;
  /* of the factor on the model's gain of the depth over the force; 0: it stays 1 */
  double depth_gain_walk;
  /* of the factor on the model's effect of the power on the copper; 0: it stays 1 */
  double thermal_gain_walk;
  /* of the time by which the power arrives later than after the model's dead time; 0: it stays 0 */
  double delay_walk_s;
  /* a measurement further off is a jump; 0: never */
  double jump_sigmas;
  /* innovations of the depth whose sum over about a second is further off are a drift; 0: never */
  double drift_sigmas;
  /* innovations of the temperature whose sum over about ten seconds is further off are heat that the model lacks; 0:
   * never */
  double heat_sigmas;
  /* standard deviations at the start, in the order of fsw_state: creep, slow, copper, tool, motor, force, heat, torque
   * scale, offsets, their rates, depth gain, thermal gain, delay */
  double start_deviation[FSW_STATES];
  /* smallest estimate of the factor on the process torque */
  double torque_scale_min;
  /* largest estimate of the factor on the process torque */
  double torque_scale_max;
  /* smallest estimate of the factor on the gain of the depth */
  double depth_gain_min;
  /* largest estimate of the factor on the gain of the depth */
  double depth_gain_max;
  /* smallest estimate of the factor on the effect of the power */
  double thermal_gain_min;
  /* largest estimate of the factor on the effect of the power */
  double thermal_gain_max;
  /* largest estimate of the delay, either way from the middle of its range, and at most half the dead time */
  double delay_max_s;
  /* a greater depth is not of this process */
  double depth_max_mm;
  /* a temperature further from the operating temperature is not of this process */
  double temperature_deviation_max_c;
  /* a greater disturbance force is not of this process */
  double force_offset_max_kn;
  /* torque samples further from their expectation by this factor are rejected */
  double torque_outlier_factor;
  /* smallest torque by which a jump of the torque scale is measured */
  double torque_min_nm;
  /* share of the inertia's peak that counts as noise: the drive's own lag smears it over two ticks */
  double torque_peak_noise_share;
  /* share of the variance of a jump of the depth that the sensor's offset gets; the tool's own depth gets the rest */
  double jump_offset_share;
  /* share of the sum of the depth's innovations that is left after a tick: it covers about a second */
  double drift_keep;
  /* share of the sum of the temperature's innovations that is left after a tick: it covers about ten seconds */
  double heat_keep;
  /* largest innovation in the sum that shows whether they last */
  double heat_steady_sigmas;
  /* innovations last once that sum is larger: eight seconds of one sign, where they are large */
  double heat_steady_sum;
  /* innovations last once they are beyond heat_sigmas for longer, where they are small */
  double heat_wait_s;
  /* time from the start during which innovations need not last, as nothing has jumped */
  double heat_start_s;
  /* the gain of the depth is estimated while the force has moved by more within two seconds */
  double excitation_force_kn;
  /* gain and delay of the power are estimated once it has moved by more within a dead time */
  double excitation_power_kw;
  /* time for which they are then estimated, after a dead time: some lags of the tool */
  double excitation_power_s;
  /* Share of the two offsets that is left after a tick. */
  double offset_keep;
  /* Share of the rate of the depth's offset that is left after a tick. */
  double depth_rate_keep;
  /* Share of the rate of the temperature's offset that is left after a tick. */
  double temperature_rate_keep;
} fsw_estimator_tuning;

typedef struct {
  /* standard deviation of the rival's delay at its start, in halves of its range */
  double rival_share;
  /* logarithm of the likelihoods' ratio at which the rival takes over */
  double evidence_max;
  /* no more is counted against the rival, so that it can still take over later */
  double counter_evidence_max;
  /* the value in use is the one nearest to the model's that lies within so many standard deviations */
  double certain_sigmas;
  /* largest change per tick of the gain in use */
  double gain_step;
  /* largest change per tick of the delay in use */
  double delay_step_s;
  /* share of the mean square of the innovations that is left after a tick: it covers about five seconds */
  double misfit_keep;
  /* mean square of the innovations, 1 where they are as expected, above which no gain and delay fit */
  double misfit_max;
  /* time constant of the mean power that heats alike with the gain in use and the estimated one */
  double power_memory_s;
} fsw_adaptation_tuning;

typedef struct {
  /* time constant of the approach near the set-point, or of the corridor (tau_t) */
  double depth_time_s;
  /* time constant of the approach near the set-point, or of the corridor (tau_t) */
  double temperature_time_s;
  /* half width of the dead-band about the trajectory */
  double dead_band_depth_mm;
  /* half width of the dead-band about the trajectory */
  double dead_band_temperature_c;
  /* an approach takes the depth no further from its set-point for the temperature */
  double quality_depth_mm;
  /* an approach lets the depth give way before the temperature falls below, whatever the priority */
  double quality_temperature_min_c;
  /* an approach lets the depth give way before the temperature rises above, whatever the priority */
  double quality_temperature_max_c;
  /* L1 weight outside the dead-band, per output point */
  double weight_depth_per_mm;
  /* L1 weight outside the dead-band, per output point */
  double weight_temperature_per_c;
  /* quadratic cost, per output point: a deviation of this size from the trajectory costs 1/2; 0: none */
  double depth_scale_mm;
  /* quadratic cost, per output point: a deviation of this size from the trajectory costs 1/2; 0: none */
  double temperature_scale_c;
  /* where the temperature has priority: deviation of the depth beyond which its cost is linear; 0: never */
  double huber_depth_mm;
  /* where the depth has priority (balance: twice this): deviation of the temperature beyond which its cost is linear;
   * 0: never, and the depth always waits for what the speed can compensate */
  double huber_temperature_c;
  /* L1 weight of the depth outside its quality limits, at the ends of the blocks */
  double quality_weight_per_mm;
  /* L1 weight of the temperature outside its quality limits, at the ends of the blocks */
  double quality_weight_per_c;
  /* L1 weight on the moves of an interval */
  double move_force_per_kn;
  /* L1 weight on the moves of an interval */
  double move_speed_per_rpm;
  /* quadratic cost of an interval's move, twice that of the largest move, for both inputs */
  double full_move_cost;
  /* of the solver: complementarity gap relative to 1 + |cost| */
  double tolerance;
  fsw_approach_tuning approach;
  fsw_estimator_tuning estimator;
  fsw_adaptation_tuning adaptation;
  /* Share of the distance to the set-point that is left after a tick of the depth's corridor. */
  double depth_corridor_keep;
  /* Share of the distance to the set-point that is left after a tick of the temperature's corridor. */
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
  int priority;
  int max_iterations;
  int plan_reuse;
} fsw_nmpc_tuning;

#define FSW_EACH_NUMBER(DO) \
  DO(depth_time_s) DO(temperature_time_s) DO(dead_band_depth_mm) DO(dead_band_temperature_c) DO(quality_depth_mm) \
  DO(quality_temperature_min_c) DO(quality_temperature_max_c) DO(weight_depth_per_mm) DO(weight_temperature_per_c) \
  DO(depth_scale_mm) DO(temperature_scale_c) DO(huber_depth_mm) DO(huber_temperature_c) DO(quality_weight_per_mm) \
  DO(quality_weight_per_c) DO(move_force_per_kn) DO(move_speed_per_rpm) DO(full_move_cost) DO(tolerance) \
  DO(approach.force_time_s) DO(approach.power_time_s) DO(approach.depth_acceleration) DO(approach.haste) \
  DO(approach.brake_share) DO(approach.rate_share) DO(approach.depth_approach_keep) \
  DO(approach.temperature_approach_keep) DO(approach.least_force_kn) DO(approach.least_rate_c_per_s) \
  DO(approach.least_power_kw) DO(estimator.depth_noise_mm) DO(estimator.torque_noise_nm) \
  DO(estimator.temperature_noise_c) DO(estimator.creep_walk_mm) DO(estimator.copper_walk_c) \
  DO(estimator.motor_walk_nm) DO(estimator.force_walk_kn) DO(estimator.heat_walk_kw) DO(estimator.torque_scale_walk) \
  DO(estimator.depth_offset_walk_mm) DO(estimator.temperature_offset_walk_c) DO(estimator.depth_rate_walk_mm_per_s) \
  DO(estimator.temperature_rate_walk_c_per_s) DO(estimator.depth_gain_walk) DO(estimator.thermal_gain_walk) \
  DO(estimator.delay_walk_s) DO(estimator.jump_sigmas) DO(estimator.drift_sigmas) DO(estimator.heat_sigmas) \
  DO(estimator.start_deviation[0]) DO(estimator.start_deviation[1]) DO(estimator.start_deviation[2]) \
  DO(estimator.start_deviation[3]) DO(estimator.start_deviation[4]) DO(estimator.start_deviation[5]) \
  DO(estimator.start_deviation[6]) DO(estimator.start_deviation[7]) DO(estimator.start_deviation[8]) \
  DO(estimator.start_deviation[9]) DO(estimator.start_deviation[10]) DO(estimator.start_deviation[11]) \
  DO(estimator.start_deviation[12]) DO(estimator.start_deviation[13]) DO(estimator.start_deviation[14]) \
  DO(estimator.torque_scale_min) DO(estimator.torque_scale_max) DO(estimator.depth_gain_min) \
  DO(estimator.depth_gain_max) DO(estimator.thermal_gain_min) DO(estimator.thermal_gain_max) DO(estimator.delay_max_s) \
  DO(estimator.depth_max_mm) DO(estimator.temperature_deviation_max_c) DO(estimator.force_offset_max_kn) \
  DO(estimator.torque_outlier_factor) DO(estimator.torque_min_nm) DO(estimator.torque_peak_noise_share) \
  DO(estimator.jump_offset_share) DO(estimator.drift_keep) DO(estimator.heat_keep) DO(estimator.heat_steady_sigmas) \
  DO(estimator.heat_steady_sum) DO(estimator.heat_wait_s) DO(estimator.heat_start_s) DO(estimator.excitation_force_kn) \
  DO(estimator.excitation_power_kw) DO(estimator.excitation_power_s) DO(estimator.offset_keep) \
  DO(estimator.depth_rate_keep) DO(estimator.temperature_rate_keep) DO(adaptation.rival_share) \
  DO(adaptation.evidence_max) DO(adaptation.counter_evidence_max) DO(adaptation.certain_sigmas) \
  DO(adaptation.gain_step) DO(adaptation.delay_step_s) DO(adaptation.misfit_keep) DO(adaptation.misfit_max) \
  DO(adaptation.power_memory_s) DO(depth_corridor_keep) DO(temperature_corridor_keep) DO(force_min_kn) \
  DO(force_max_kn) DO(speed_min_rpm) DO(speed_max_rpm) DO(force_step_kn) DO(speed_step_rpm) DO(blind_limit_s)

#define FSW_EACH_SHARE(DO) \
  DO(approach.brake_share) DO(approach.rate_share) DO(approach.depth_approach_keep) \
  DO(approach.temperature_approach_keep) DO(estimator.torque_peak_noise_share) DO(estimator.jump_offset_share) \
  DO(estimator.offset_keep) DO(estimator.depth_rate_keep) DO(estimator.temperature_rate_keep) \
  DO(adaptation.misfit_keep) DO(depth_corridor_keep) DO(temperature_corridor_keep)

#endif
