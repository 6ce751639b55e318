/* The process torque (19)-(22) and its gradient, generated from the CasADi model (torque.c). */
#ifndef FSW_TORQUE_H
#define FSW_TORQUE_H

int fsw_torque_casadi(const double **arg, double **res); /* of force, depth, parameters */

#endif
