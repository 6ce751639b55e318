/* Generated from fsw_model/equations.py by fsw_nmpc/kernel_codegen.py; do not edit. */
/* Written by CasADi 3.8.2. */
#include "internal.h"

static double casadi_sq(double x) { return x*x;}

int fsw_torque_casadi(const double **arg, double **res) {
  double a00, a01, a02, a03, a04, a05, a06, a07, a08, a09, a10, a11; double a12, a13,
  a14; a00=arg[2][0]; a01=arg[2][1]; a02=1000.; a03=arg[0][0]; a03=(a02*a03);
  a04=3.1415926535897931e+00; a05=arg[2][2]; a06=arg[2][3]; a07=1.0000000000000000e-03;
  a08=arg[1][0]; a08=(a07*a08); a08=(a06*a08); a08=(a05+a08); a09=casadi_sq(a08); a10=(a04*a09);
  a03=(a03/a10); a11=(a01*a03); a00=(a00+a11); a11=arg[2][4]; a12=arg[2][5]; a13=(a08*a09);
  a14=casadi_sq(a05); a05=(a05*a14); a13=(a13-a05); a13=(a12*a13); a11=(a11+a13); a13=(a00*a11);
  res[0][0]=a13; a01=(a01*a11); a11=(a01/a10); a02=(a02*a11); res[0][1]=a02; a12=(a12*a00);
  a09=(a09*a12); a00=(2.*a08); a08=(a08*a12); a08=(a00*a08); a09=(a09+a08); a03=(a03/a10);
  a03=(a03*a01); a04=(a04*a03); a00=(a00*a04); a09=(a09-a00); a06=(a06*a09); a07=(a07*a06);
  res[0][2]=a07; return 0;
}
