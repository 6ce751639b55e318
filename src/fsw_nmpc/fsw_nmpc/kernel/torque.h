/* The process torque (19)-(22) and its gradient, generated from the CasADi model (torque.c). */
#ifndef FSW_NMPC_TORQUE_H
#define FSW_NMPC_TORQUE_H

int fsw_torque_casadi(const double **arg, double **res, int *iw, double *w, int mem);

/* out = torque (N m), its derivative by force (N m/kN) and by depth (N m/mm) */
static inline void fsw_torque(double force_kn, double depth_mm, const double *parameters, double out[3]) {
  const double *arg[3] = {&force_kn, &depth_mm, parameters};
  double *res[1] = {out};
  fsw_torque_casadi(arg, res, 0, 0, 0);
}

#endif
