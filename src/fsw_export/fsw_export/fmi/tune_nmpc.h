/* The parameters of the NMPC's FMU. */
/* The exported tuning with the parameters in place, as Tuning.with_knobs and Tuning.struct. */
static int controller_tune(controller_tuning *t, const fmu_reals *v, const fmu_integers *n, char *message) {
  const double faster[2] = {v->depth_aggressiveness / START_DEPTH_AGGRESSIVENESS,
                            v->temperature_aggressiveness / START_TEMPERATURE_AGGRESSIVENESS};
  const double calmer = v->calmness / START_CALMNESS;
  const double move_max[2] = {v->force_step, v->speed_step};
  *t = fsw_nmpc_exported_tuning;
  for (int q = 0; q < 2; q++) {
    const double share = t->move_max[q] / move_max[q];
    t->time_s[q] /= faster[q];
    if (faster[q] != 1.0 && t->time_s[q] > 0.0) t->corridor_decay[q] = exp(-FMU_STEP_S / t->time_s[q]);
    if (t->trajectory == FSW_APPROACH && t->time_s[q] < 2.0 * FMU_STEP_S) {
      snprintf(message, FMU_MESSAGE, "%s_aggressiveness: with %g the approach takes %.3g s; it takes at least %g s",
               q ? "temperature" : "depth", q ? v->temperature_aggressiveness : v->depth_aggressiveness, t->time_s[q],
               2.0 * FMU_STEP_S);
      return 1;
    }
    t->move_weight[q] *= calmer;
    t->move_square[q] *= calmer * share * share;
    t->move_max[q] = move_max[q];
  }
  for (int i = 0; i < FSW_STATES; i++) t->walk[i] /= calmer;
  t->input_min[0] = v->force_min;
  t->input_max[0] = v->force_max;
  t->input_min[1] = v->speed_min;
  t->input_max[1] = v->speed_max;
  t->blind_limit_s = v->blind_limit;
  t->max_iterations = n->max_iterations;
  t->plan_reuse = n->plan_reuse;
  return 0;
}
