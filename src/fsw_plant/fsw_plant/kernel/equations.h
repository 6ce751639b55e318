/* The process's equations: see general_functions() in fsw_model/equations.py. */
#ifndef FSW_PLANT_EQUATIONS_H
#define FSW_PLANT_EQUATIONS_H

#include <math.h>

int process_heat(const double **arg, double **res);
int process_met(const double **arg, double **res);
int process_step(const double **arg, double **res);
int process_outputs(const double **arg, double **res);

#endif
