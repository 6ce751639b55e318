/* Heat that is known beforehand: used as far as it explains the temperature.
 *
 * Only its changes enter: the heat disturbance of the estimator moves with them, and so does that along the horizon. What is
 * wrong about the known heat as a whole is in the disturbance, as any heat; nothing jumps where the knowledge begins or ends.
 *
 * The gate: two vectors carry along, with the filter's own gains, what the known heat would do to the states if all of it
 * were used, and what the share in use does. They give the innovations of a filter that uses all of it, and of one that uses
 * none. The logarithm of their likelihoods' ratio is summed, at most 1 a tick, and fades; the share falls with it to 0. */
#include "internal.h"

#define N FSW_STATES

enum { TEMPERATURE = 2 };
enum { ALL, USED };

/* At the start of a weld whose heat is known: the tool need not be at rest but warms or cools, at a rate that tells how much
 * heat there is, and by which the copper is ahead of it. */
void fsw_known_heat_start(fsw_estimator *e, const fsw_nmpc_model *m, const fsw_estimator_tuning *t,
                          const fsw_nmpc_input *in) {
  e->known_weight = 1.0;
  if (!(in->known_deviation_kw > 0.0)) return;
  const double heat = t->known_heat_start_kw, copper = heat * m->thermal_gain_c_per_kw / m->copper_lag_s * m->tool_lag_s;
  e->p[FSW_HEAT][FSW_HEAT] += heat * heat;
  e->p[FSW_COPPER][FSW_COPPER] += copper * copper;
  e->p[FSW_HEAT][FSW_COPPER] = e->p[FSW_COPPER][FSW_HEAT] = heat * copper;
}

/* The heat of the tick that just ended; before it is predicted. */
void fsw_known_heat_rise(fsw_estimator *e, const fsw_estimator_tuning *t, const fsw_nmpc_input *in) {
  const double rise = in->known_rise_kw;
  const double deviation = e->known_weight * fsw_clip(in->known_deviation_kw, 0.0, t->known_heat_walk_kw);
  if (!fsw_is_finite(rise + deviation)) return;
  e->x[FSW_HEAT] += e->known_weight * rise;
  e->p[FSW_HEAT][FSW_HEAT] += deviation * deviation;
  e->by_known[ALL][FSW_HEAT] += rise;
  e->by_known[USED][FSW_HEAT] += e->known_weight * rise;
}

/* One tick of the filter's own linear dynamics, for both vectors. */
void fsw_known_heat_predict(fsw_estimator *e) {
  for (int k = 0; k < 2; k++) {
    double next[N] = {0.0};
    for (int i = 0; i < N; i++)
      for (int j = 0; j < N; j++) next[i] += e->a[i][j] * e->by_known[k][j];
    for (int i = 0; i < N; i++) e->by_known[k][i] = next[i];
  }
}

/* An update of the states with a gain. Both vectors lose what the filter corrects, as its states do. */
void fsw_known_heat_correct(fsw_estimator *e, const double row[N], const double gain[N]) {
  for (int k = 0; k < 2; k++) {
    e->shown[k] = 0.0;
    for (int i = 0; i < N; i++) e->shown[k] += row[i] * e->by_known[k][i];
    for (int i = 0; i < N; i++) e->by_known[k][i] -= gain[i] * e->shown[k];
  }
}

/* After an update of the temperature: a sequential likelihood-ratio test (Wald 1945) of "all of the
 * known heat" against "none of it". A fading sum forgets, so that heat that was wrong once can be used
 * again; a single tick counts at most 1, so that a spike decides nothing. */
void fsw_known_heat_judge(fsw_estimator *e, const fsw_estimator_tuning *t) {
  const double none = e->innovation[TEMPERATURE] + e->shown[USED], all = none - e->shown[ALL];
  const double more = 0.5 * (none * none - all * all) / e->expected[TEMPERATURE];
  const double most = t->known_heat_evidence, evidence = t->known_heat_keep * e->known_evidence + fsw_clip(more, -1.0, 1.0);
  e->known_evidence = fsw_clip(evidence, -t->known_heat_counter_evidence, most);
  const double weight = fsw_clip(1.0 + e->known_evidence / most, 0.0, 1.0);
  e->known_weight = fsw_clip(weight, e->known_weight - t->known_heat_step, e->known_weight + t->known_heat_step);
}

/* The known heat along the horizon, into c->problem; none where any of it is not finite. */
void fsw_known_heat_ahead(fsw_nmpc *c, const fsw_nmpc_input *in) {
  double sum = 0.0;
  for (int k = 0; k < c->model.n_steps; k++) sum += in->known_ahead_kw[k];
  const double weight = fsw_is_finite(sum) ? c->estimator.known_weight : 0.0;
  for (int k = 0; k < c->model.n_steps; k++)
    c->problem.start.heat_ahead_kw[k] = weight > 0.0 ? weight * in->known_ahead_kw[k] : 0.0;
}
