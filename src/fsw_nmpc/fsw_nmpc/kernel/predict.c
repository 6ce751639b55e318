/* Prediction over the horizon with exact first-order sensitivities to all moves.
 *
 * Within a step the process torque is linear between its end values. The motor torque (18) is then
 * q0 + q1 s/h + rest exp(-s/lag), and the power (24) P0 + P1 s/h + P2 exp(-s/lag): three
 * coefficients per step, which enter (16) one dead time later with precomputed, exact weights. The
 * paper's tool uses an implicit first-order scheme instead. */
#include "internal.h"

/* Row of sensitivities of a torque: directly by the force (count of moved intervals), and by
 * depth. */
static void torque_row(fsw_torque t, const double *count, const double *dz, int width, double *restrict row) {
  for (int j = 0; j < width; j += 2) {
    row[j] = t.by_force * count[j >> 1] + t.by_depth * dz[j];
    row[j + 1] = t.by_depth * dz[j + 1];
  }
}

/* States along the horizon; their sensitivities are in the path. */
typedef struct { double creep, slow, copper, tool, motor, force, speed; } fsw_point;

/* Depth (27) and its sensitivities; the fast mode (0.95 ms) has settled. */
static double depth_of(const fsw_nmpc_model *m, double gain, const fsw_point *z, double pushed, int width, fsw_path *p) {
  const double softening = 1.0 + m->softening_per_c * z->tool;
  const double moved = m->operating_depth_mm + z->creep + z->slow + gain * m->fast_gain * pushed;
  for (int j = 0; j < width; j += 2) {
    p->d_depth[j] = softening * (p->d_creep[j] + p->d_slow[j] + gain * m->fast_gain * p->count[j >> 1]) +
                    m->softening_per_c * moved * p->d_tool[j];
    p->d_depth[j + 1] = m->softening_per_c * moved * p->d_tool[j + 1];
  }
  return moved * softening;
}

/* Depth over force (17): partial fractions of creep and the slow mode, exact over the step. */
static void step_depth(const double *mode, double gain, double pushed, int width, fsw_point *z, fsw_path *p) {
  const double creep_gain = gain * mode[0], slow_decay = mode[1], slow_gain = gain * mode[2];
  z->creep += creep_gain * pushed;
  z->slow = slow_decay * z->slow + slow_gain * pushed;
  for (int j = 0; j < width; j += 2) {
    const double n = p->count[j >> 1];
    p->d_creep[j] += creep_gain * n;
    p->d_slow[j] = slow_decay * p->d_slow[j] + slow_gain * n;
  }
}

/* Copper and tool (16), driven by the power of one dead time ago. */
static void step_heat(const fsw_nmpc_model *m, const fsw_start *s, int k, int width, fsw_point *z, fsw_path *p) {
  const double *mode = m->modes + k * FSW_MODES, heat = s->x[FSW_HEAT] + s->heat_ahead_kw[k];
  fsw_heat_step(mode, heat, &z->copper, &z->tool);
  for (int j = 0; j < width; j++) {
    p->d_tool[j] = mode[6] * p->d_copper[j] + mode[7] * p->d_tool[j];
    p->d_copper[j] = mode[5] * p->d_copper[j];
  }
  for (int e = m->weight_start[k]; e < m->weight_start[k + 1]; e++) {
    const double *g = m->weight + 6 * e;
    const int segment = m->weight_segment[e] - m->n_history;
    const double *power = segment < 0 ? s->history + 3 * m->weight_segment[e] : p->power[segment];
    z->copper += g[0] * power[0] + g[1] * power[1] + g[2] * power[2];
    z->tool += g[3] * power[0] + g[4] * power[1] + g[5] * power[2];
    if (segment < 0) continue;
    const double *restrict d0 = p->d_power[segment][0], *restrict d1 = p->d_power[segment][1];
    const double *restrict d2 = p->d_power[segment][2];
    double *restrict d_copper = p->d_copper, *restrict d_tool = p->d_tool;
    for (int j = 0; j < p->width[segment]; j++) {
      d_copper[j] += g[0] * d0[j] + g[1] * d1[j] + g[2] * d2[j];
      d_tool[j] += g[3] * d0[j] + g[4] * d1[j] + g[5] * d2[j];
    }
  }
}

/* Motor torque (18) and power (24) from the process torque at both ends of the step. */
static void step_power(const fsw_nmpc_model *m, const fsw_start *s, int k, double left, double right, fsw_point *z,
                       fsw_path *p) {
  const double motor_decay = m->modes[k * FSW_MODES + 3], lag = m->modes[k * FSW_MODES + 4];
  const double turning = z->speed + s->speed_offset_rpm, friction = fsw_friction(m, turning);
  const double by_speed = m->friction[1] + 2.0 * m->friction[2] * turning;
  const double rise = right - left, start = left - lag * rise;
  const double rest = z->motor - friction - start, kw = FSW_KW_PER_NM_RPM * turning;
  double *restrict p0 = p->d_power[k][0], *restrict p1 = p->d_power[k][1], *restrict p2 = p->d_power[k][2];
  p->power[k][0] = kw * start - m->operating_power_kw;
  p->power[k][1] = kw * rise;
  p->power[k][2] = kw * rest;
  for (int j = 0; j < p->width[k]; j++) {
    const double n = j & 1 ? p->count[j >> 1] : 0.0; /* change of the speed by the move */
    const double d_rise = p->d_right[j] - p->d_left[j], d_start = p->d_left[j] - lag * d_rise;
    const double d_rest = p->d_motor[j] - by_speed * n - d_start;
    p0[j] = kw * d_start + FSW_KW_PER_NM_RPM * start * n;
    p1[j] = kw * d_rise + FSW_KW_PER_NM_RPM * rise * n;
    p2[j] = kw * d_rest + FSW_KW_PER_NM_RPM * rest * n;
    p->d_motor[j] = d_start + d_rise + by_speed * n + motor_decay * d_rest;
  }
  z->motor = start + rise + friction + motor_decay * rest;
}

/* One pass over the steps: states and their derivatives by all moves together (forward mode). A move
 * acts from its interval on, so a step has only `width` nonzero columns. */
int fsw_predict(const fsw_nmpc_model *m, const fsw_start *s, const double *v, fsw_workspace *w) {
  fsw_path *p = &w->scratch.path;
  fsw_point z = {s->x[0], s->x[1], s->x[2], s->x[3], s->x[4], s->force_kn, s->speed_rpm};
  const double scale = s->x[FSW_SCALE], gain = s->x[FSW_DEPTH_GAIN];
  double sum = 0.0;
  int interval = -1, out = 0;
  for (int j = 0; j < 2 * m->n_blocks; j++) {
    p->d_creep[j] = p->d_slow[j] = p->d_copper[j] = p->d_tool[j] = p->d_motor[j] = p->d_depth[j] = 0.0;
    p->count[j >> 1] = 0.0;
  }
  for (int k = 0; k < m->n_steps; k++) {
    if (m->step_interval[k] != interval) {
      interval = m->step_interval[k];
      const int block = m->interval_block[interval];
      p->count[block] += 1.0;
      z.force += v[2 * block];
      z.speed += v[2 * block + 1];
    }
    const int width = p->width[k] = 2 * (m->interval_block[interval] + 1);
    const double acting = z.force + s->x[FSW_FORCE], pushed = acting - m->operating_force_kn;
    /* the torque at both ends of the step, since depth and softening change within it */
    const fsw_torque left = fsw_torque_at(m, scale, acting, depth_of(m, gain, &z, pushed, width, p));
    torque_row(left, p->count, p->d_depth, width, p->d_left);
    step_depth(m->modes + k * FSW_MODES, gain, pushed, width, &z, p);
    step_heat(m, s, k, width, &z, p);
    const double depth = depth_of(m, gain, &z, pushed, width, p);
    const fsw_torque right = fsw_torque_at(m, scale, acting, depth);
    torque_row(right, p->count, p->d_depth, width, p->d_right);
    step_power(m, s, k, left.value, right.value, &z, p);
    sum += depth + z.tool + z.motor + p->power[k][0] + p->power[k][1] + p->power[k][2];
    while (out < m->n_out && m->out_step[out] == k) {
      const int below = m->n_out + out;
      w->output[out] = depth + s->x[FSW_DEPTH_OFFSET] + s->drift[0][out];
      w->output[below] = m->operating_temperature_c + z.tool + s->x[FSW_TEMP_OFFSET] + s->drift[1][out];
      for (int j = 0; j < m->depth_width[out]; j++) w->by[out][j] = p->d_depth[j];
      for (int j = 0; j < m->temperature_width[out]; j++) w->by[below][j] = p->d_tool[j];
      out++;
    }
  }
  return fsw_is_finite(sum) ? FSW_OK : FSW_NOT_FINITE;
}
