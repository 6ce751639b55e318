/* Prediction over the horizon with exact first-order sensitivities to all moves. */
#include "internal.h"
#include "torque.h"

#define KW_PER_NM_RPM (3.14159265358979323846 / 30000.0)

typedef struct { double value, by_force, by_depth; } torque_t;

static torque_t torque_at(const fsw_nmpc_model *m, double scale, double force, double depth) {
  double out[3];
  fsw_torque(force, depth, m->torque_par, out);
  torque_t t = {scale * out[0], scale * out[1], scale * out[2]};
  return t;
}

/* Power node P = k w M(F, z) and its row of sensitivities; `width` leading variables may be non-zero. */
static double power_node(torque_t t, double speed, const double *count, const double *dz, int width, double *row) {
  const double kw = KW_PER_NM_RPM * speed;
  for (int j = 0; j < width; j += 2) {
    const double n = count[j >> 1];
    row[j] = kw * (t.by_force * n + t.by_depth * dz[j]);
    row[j + 1] = kw * t.by_depth * dz[j + 1] + KW_PER_NM_RPM * t.value * n;
  }
  return kw * t.value;
}

int fsw_predict_into(const fsw_nmpc_model *m, const fsw_nmpc_call *c, const double *v, fsw_workspace *w) {
  fsw_path *p = &w->scratch.path;
  const int nv = 2 * m->n_blocks;
  double creep = c->x[0], slow = c->x[1], fast = c->x[2], thermal = c->x[3], temp = c->x[4];
  double force = c->force_kn, speed = c->speed_rpm;
  double depth = m->operating_depth_mm + creep + slow + fast + thermal;
  double sum = depth + temp;
  int interval = -1, out = 0;
  for (int j = 0; j < nv; j++) {
    p->d_creep[j] = p->d_slow[j] = p->d_fast[j] = p->d_thermal[j] = p->d_temp[j] = p->d_depth[j] = 0.0;
    p->count[j >> 1] = 0.0;
  }
  for (int k = 0; k < m->n_steps; k++) {
    if (m->step_interval[k] != interval) {
      interval = m->step_interval[k];
      const int block = m->interval_block[interval];
      p->count[block] += 1.0;
      force += v[2 * block];
      speed += v[2 * block + 1];
    }
    const int width = 2 * (m->interval_block[interval] + 1);
    const double *mode = m->modes + (long)k * FSW_MODES;
    const double pushed = force + c->force_offset_kn - m->operating_force_kn;
    double *left = p->d_power[k][0], *right = p->d_power[k][1];
    p->power[k][0] =
        power_node(torque_at(m, c->torque_scale, force + c->force_offset_kn, depth), speed, p->count, p->d_depth, width, left);
    p->width[k] = width;

    /* depth driven by force: three modes, exact over the step */
    creep += mode[0] * pushed;
    slow = mode[1] * slow + mode[2] * pushed;
    fast = mode[3] * fast + mode[4] * pushed;
    for (int j = 0; j < width; j += 2) {
      const double n = p->count[j >> 1];
      p->d_creep[j] += mode[0] * n;
      p->d_slow[j] = mode[1] * p->d_slow[j] + mode[2] * n;
      p->d_fast[j] = mode[3] * p->d_fast[j] + mode[4] * n;
    }
    /* temperature and thermal depth driven by the power one dead time ago */
    thermal = mode[5] * thermal + mode[6] * temp + mode[8];
    temp = mode[7] * temp + mode[9];
    for (int j = 0; j < width; j++) {
      p->d_thermal[j] = mode[5] * p->d_thermal[j] + mode[6] * p->d_temp[j];
      p->d_temp[j] = mode[7] * p->d_temp[j];
    }
    for (int e = m->weight_start[k]; e < m->weight_start[k + 1]; e++) {
      const double *g = m->weight + 4L * e;
      const int segment = m->weight_segment[e] - m->n_history;
      if (segment < 0) {
        const double *known = c->history + 2L * m->weight_segment[e];
        thermal += g[0] * known[0] + g[1] * known[1];
        temp += g[2] * known[0] + g[3] * known[1];
        continue;
      }
      thermal += g[0] * p->power[segment][0] + g[1] * p->power[segment][1];
      temp += g[2] * p->power[segment][0] + g[3] * p->power[segment][1];
      const double *pl = p->d_power[segment][0], *pr = p->d_power[segment][1];
      const int reach = p->width[segment];
      for (int j = 0; j < reach; j++) {
        p->d_thermal[j] += g[0] * pl[j] + g[1] * pr[j];
        p->d_temp[j] += g[2] * pl[j] + g[3] * pr[j];
      }
    }
    depth = m->operating_depth_mm + creep + slow + fast + thermal;
    for (int j = 0; j < width; j += 2) {
      p->d_depth[j] = p->d_creep[j] + p->d_slow[j] + p->d_fast[j] + p->d_thermal[j];
      p->d_depth[j + 1] = p->d_thermal[j + 1];
    }
    p->power[k][1] =
        power_node(torque_at(m, c->torque_scale, force + c->force_offset_kn, depth), speed, p->count, p->d_depth, width, right);
    sum += p->power[k][0] + p->power[k][1] + depth + temp;
    while (out < m->n_out && m->out_step[out] == k) {
      const int below = m->n_out + out;
      w->output[out] = depth + c->depth_offset_mm;
      w->output[below] = temp + c->temp_offset_c;
      for (int j = 0; j < m->depth_width[out]; j++) w->by[out][j] = p->d_depth[j];
      for (int j = 0; j < m->temp_width[out]; j++) w->by[below][j] = p->d_temp[j];
      out++;
    }
  }
  return is_finite(sum) ? FSW_OK : FSW_FAILED;
}

int fsw_nmpc_predict(const fsw_nmpc_model *m, const fsw_nmpc_call *c, const double *v, double *depth, double *temp,
                     double *by_depth, double *by_temp, void *workspace) {
  fsw_workspace *w = workspace;
  const int nv = 2 * m->n_blocks;
  const int status = fsw_predict_into(m, c, v, w);
  for (int i = 0; i < m->n_out; i++) {
    depth[i] = w->output[i];
    temp[i] = w->output[m->n_out + i];
    if (by_depth == 0 || by_temp == 0) continue;
    for (int j = 0; j < nv; j++) {
      by_depth[(long)i * nv + j] = j < m->depth_width[i] ? w->by[i][j] : 0.0;
      by_temp[(long)i * nv + j] = j < m->temp_width[i] ? w->by[m->n_out + i][j] : 0.0;
    }
  }
  return status;
}
