/* Functions shared by the library's files; not part of the interface. */
#ifndef FSW_INTERNAL_H
#define FSW_INTERNAL_H

#include "fsw_nmpc.h"

#define FSW_KW_PER_NM_RPM (3.14159265358979323846 / 30000.0)

static inline int fsw_is_finite(double x) { return x - x == 0.0; }
static inline double fsw_clip(double x, double low, double high) { return x < low ? low : (x > high ? high : x); }

/* Copper and tool (16) over a step of constant power. */
static inline void fsw_heat_step(const double *mode, double power_kw, double *copper, double *tool) {
  *tool = mode[6] * *copper + mode[7] * *tool + mode[9] * power_kw;
  *copper = mode[5] * *copper + mode[8] * power_kw;
}

/* Bounds and largest change per tick of input q. */
static inline double fsw_least(const fsw_nmpc_tuning *t, int q) { return q ? t->speed_min_rpm : t->force_min_kn; }
static inline double fsw_most(const fsw_nmpc_tuning *t, int q) { return q ? t->speed_max_rpm : t->force_max_kn; }
static inline double fsw_reach(const fsw_nmpc_tuning *t, int q) { return q ? t->speed_step_rpm : t->force_step_kn; }

/* torque.c: of force, depth, parameters */
int fsw_torque_casadi(const double **arg, double **res);

/* estimator.c */
typedef struct { double value, by_force, by_depth; } fsw_torque;
/* the scale is the estimated one, which absorbs an error of the torque's level */
fsw_torque fsw_torque_at(const fsw_nmpc_model *m, double scale, double force_kn, double depth_mm);
double fsw_friction(const fsw_nmpc_model *m, double speed_rpm);
int fsw_estimator_start(fsw_estimator *e, const fsw_nmpc_model *m, const fsw_estimator_tuning *t,
                        const fsw_nmpc_input *in);
int fsw_estimator_step(fsw_estimator *e, const fsw_nmpc_model *m, const fsw_estimator_tuning *t,
                       const fsw_nmpc_input *in);

/* known_heat.c */
void fsw_known_heat_start(fsw_estimator *e, const fsw_nmpc_model *m, const fsw_estimator_tuning *t,
                          const fsw_nmpc_input *in);
void fsw_known_heat_rise(fsw_estimator *e, const fsw_estimator_tuning *t, const fsw_nmpc_input *in);
void fsw_known_heat_predict(fsw_estimator *e);
void fsw_known_heat_correct(fsw_estimator *e, const double row[FSW_STATES], const double gain[FSW_STATES]);
void fsw_known_heat_judge(fsw_estimator *e, const fsw_estimator_tuning *t);
void fsw_known_heat_ahead(fsw_nmpc *c, const fsw_nmpc_input *in);

/* trajectory.c */
void fsw_trajectories(fsw_nmpc *c, const fsw_nmpc_input *in);

/* rows.c */
double fsw_dot(const double *a, const double *b, int n);
void fsw_build(const fsw_nmpc_model *m, const fsw_nmpc_tuning *t, const fsw_problem *problem, const double *v,
               fsw_workspace *w);
void fsw_row_products(const fsw_workspace *w, int first, const double *z, double *value, double *input);
void fsw_add_transposed(const fsw_workspace *w, int first, const double *row_force, const double *input_force, double *out);

/* factor.c */
int fsw_factorise(fsw_workspace *w, int again);
void fsw_substitute(const fsw_workspace *w, double *x);

#endif
