// A step of the edge filter of one world: the body of a native function. The equations are in filter.py.
//
// In and out: state (what is believed), grids (what rays said, by node, layer and cell); in: given, setup and numbers as filter.py
// lays them out, aim (directions of the beams in the machine frame, toward the crop counted positive), ago [s], ranges [m];
// out: told. Numbers that stand in the text are estimates, as those of Params without a source [m, m/s, rad, nat, 1/m].

typedef double D;
constexpr int L = 10, C = 90, K = 16, W = C + 2 * K, NODES = 48, S = 80;  // layers, cells, half template, padded row, nodes, cells of the start
constexpr D STEP = 0.4, CELL = 0.04, E0 = -0.5 * C * CELL, WIDE = 0.1, W0 = -0.5 * S * WIDE;
constexpr D MANY = 1e9, SAME = 0.02, BEFORE = 0.15, FARTHEST = 2.0, RARE = 1e-3, LEVEL = 1e-3;
// SAME: change of the plants' shape below which nodes are not weighed anew; BEFORE: of a row spacing, that the outermost row may be
// found on the near side of the wall; FARTHEST: way of rays into crop [m]; RARE: chance below which a shape is left out; LEVEL: rise
// per range above which a ray comes down to no layer
constexpr int LEANS = 10, WIDTHS = 4, SHAPES = LEANS + WIDTHS, BINS = 24, TABLE = 512;
constexpr D LEAN[LEANS] = {-0.6, -0.45, -0.3, -0.15, 0.0, 0.15, 0.3, 0.45, 0.6, 0.9};  // of the crop's side toward the crop, per height
constexpr D WIDTH[WIDTHS] = {0.03, 0.06, 0.11, 0.2};  // standard deviation of the plants' parts about their feet, and of spots
struct Given { D seconds, age, speed, rate, crab, rise, beams, is_new; };
struct Setup { D x, y, z, reference, centre, usual, is_usual, layer, lowest, rows; };
struct Numbers {
  D search, begin_nat, denser, begin_m, bend, turn, bend_sd, turn_sd, tooth_m, tooth, tooth_first, memory, hole, hole_ends, apart, wall_stays, wall_none,
    wall_step, prior, least, bend_tail, over_first, clear, drift, lost, hold, lean_sd, shape_alike, height_sd, row_seen, delay, misfit;
};
struct Node {
  D x, u, phi, bend;             // a place of the reference path
  D a, b, turn;                  // from the node before: along, aside, angle
  D scans, learned;              // how often seen; whether learned from
  D eta, prec, edge, hole;       // site of this node's rays in e; what they say for an edge, for a hole
  D standing, before[4], cover[16], mean[4], cov[16];  // predicted and smoothed (y, theta, kappa, tooth)
  D pi;                          // chance of an edge, from the neighbours alone
  D gust;                        // variance of the step of the bend to here, per metre
};
struct Rates { D n[L], x[L], lost, rays; };
struct Head {
  D X, U, psi, level, slope, known, since, way, scans, first, count, touched, alpha, over, tooth2, height, learned;
  D mean[4], cov[16];            // before the first node's rays
  D free, lean, width;           // how far rays come into the crop [m]; means of the shape that all nodes were weighed with
  D row_angle, row_seen, row_n[BINS], row_x[BINS];  // direction of the rows, nodes that it is learned from; stops and metres by place between rows
  Rates in, out;                 // learned from nodes that no ray reaches any more
  D mu_in[L], mu_out[L], q_in, q_out;
  D said[SHAPES], aside[SHAPES], chance[SHAPES];  // of each shape of the edge: log-likelihood, where it puts the feet, posterior
  Node nodes[NODES];
};
constexpr int GRID = 2 * L * W + 2 * W + 3 * (C + 1);  // floats of a node: stops, paths, rays, lost, score, wall, likelihood
constexpr int STATE = 2886, GRIDS = 144208;  // numbers of either, as filter.py makes room for them
static_assert(sizeof(Head) == STATE * sizeof(D) && NODES * GRID + 2 * L * S + 2 * S + TABLE == GRIDS);
const Given& g = *(const Given*)given.data;
const Setup& s = *(const Setup*)setup.data;
const Numbers& p = *(const Numbers*)numbers.data;
Head& h = *(Head*)state.data;
float* const all = (float*)grids.data;
D* const out = (D*)told.data;

auto node = [&](int k) -> Node& { return h.nodes[((int)h.first + k) % NODES]; };
auto grid = [&](int k) -> float* { return all + (long)(((int)h.first + k) % NODES) * GRID; };
float* const wide = all + (long)NODES * GRID;  // of the start: stops, paths (L, S), rays, lost (S,)
float* const normal = wide + 2 * L * S + 2 * S;  // share of a normal below -4 to 4
auto sq = [](D v) { return v * v; };
auto least = [](D a, D b) { return a < b ? a : b; };
auto most = [](D a, D b) { return a > b ? a : b; };
auto clip = [](D v, D a, D b) { return v < a ? a : v > b ? b : v; };
auto share_below = [](D v) {  // of a normal: 1 / (1 + exp(-1.702 v)) is within 0.01 of it
  return 1.0 / (1.0 + ::exp(-1.702 * v));
};
auto erf_ = [](D v) {  // Abramowitz and Stegun 7.1.26, within 1.5e-7, v >= 0
  const D t = 1.0 / (1.0 + 0.3275911 * v);
  return 1.0 - ((((1.061405429 * t - 1.453152027) * t + 1.421413741) * t - 0.284496736) * t + 0.254829592) * t * ::exp(-v * v);
};

// ---- Motion: the frame at rest
auto moved = [&](D seconds, D& x, D& u, D& psi) {
  const D course = h.psi + 0.5 * g.rate * seconds - g.crab, way = g.speed * seconds;
  x = h.X + way * ::cos(course), u = h.U + way * ::sin(course), psi = h.psi + g.rate * seconds;
};
auto wipe = [&](int k) {
  float* q = grid(k);
  for (int i = 0; i < GRID; ++i) q[i] = 0.0f;
  for (int i = 0; i <= C; ++i) q[2 * L * W + 2 * W + C + 1 + i] = 1.0f / (C + 1);
};
auto clear_rates = [&](Rates& r) {
  for (int l = 0; l < L; ++l) r.n[l] = r.x[l] = 0.0;
  r.lost = r.rays = 0.0;
};
auto lose = [&]() {
  h.count = h.first = h.since = h.way = h.scans = 0.0, h.touched = MANY;
  h.over = p.over_first, h.tooth2 = sq(p.tooth_first), h.learned = 0.0, h.height = s.usual;
  clear_rates(h.in), clear_rates(h.out);
  h.free = h.lean = h.width = h.row_angle = h.row_seen = 0.0;
  for (int i = 0; i < BINS; ++i) h.row_n[i] = h.row_x[i] = 0.0;
  for (int f = 0; f < SHAPES; ++f) {
    h.said[f] = h.aside[f] = 0.0;
  }
  for (int i = 0; i < TABLE; ++i) normal[i] = (float)share_below(8.0 * (i + 0.5) / TABLE - 4.0);
  for (int i = 0; i < 2 * L * S + 2 * S; ++i) wide[i] = 0.0f;
};
auto renew = [&](Node& n, const Node* from) {  // a node from the one before
  n.scans = n.learned = n.eta = n.prec = 0.0, n.edge = n.hole = 1.0, n.standing = 1.0, n.pi = 1.0, n.gust = sq(p.bend);
  for (int i = 0; i < 4; ++i) n.mean[i] = 0.0;
  for (int i = 0; i < 16; ++i) n.cov[i] = i % 5 ? 0.0 : 1.0;
  if (!from) return;
  const Node& f = *from;
  n.bend = clip(f.mean[2], -0.12, 0.12);
  const D c = ::cos(f.phi), d = ::sin(f.phi), angle = f.phi + f.mean[1], mid = angle + 0.5 * n.bend * STEP;
  n.x = f.x - d * f.mean[0] + STEP * ::cos(mid), n.u = f.u + c * f.mean[0] + STEP * ::sin(mid), n.phi = angle + n.bend * STEP;
  const D dx = n.x - f.x, du = n.u - f.u;
  n.a = c * dx + d * du, n.b = c * du - d * dx, n.turn = n.phi - f.phi;
  for (int i = 0; i < 3; ++i) n.mean[i] = i == 2 ? f.mean[2] : 0.0;
};

// ---- Kalman: (y, theta, kappa, tooth)
auto onward = [&](const Node& n, D tooth2, D* m, D* P) {  // from the node before to n
  const D a = n.a, q = 0.5 * a * a, r = ::exp(-a / p.tooth_m);
  const D y = m[0] + a * m[1] + q * m[2] - n.b, t = m[1] + a * m[2] - n.turn;
  m[0] = y, m[1] = t, m[3] *= r;
  for (int j = 0; j < 4; ++j) P[j] += a * P[4 + j] + q * P[8 + j], P[4 + j] += a * P[8 + j], P[12 + j] *= r;
  for (int i = 0; i < 16; i += 4) P[i] += a * P[i + 1] + q * P[i + 2], P[i + 1] += a * P[i + 2], P[i + 3] *= r;
  P[5] += sq(p.turn) * a, P[10] += n.gust * a, P[15] += tooth2 * (1.0 - r * r);
};
auto given_site = [&](const Node& n, D* m, D* P) {  // y + tooth is measured
  if (n.prec < 1e-6) return;
  D hP[4];
  for (int i = 0; i < 4; ++i) hP[i] = P[4 * i] + P[4 * i + 3];
  const D v = hP[0] + hP[3], k = 1.0 / (v + 1.0 / n.prec), away = n.eta / n.prec - m[0] - m[3];
  for (int i = 0; i < 4; ++i) m[i] += hP[i] * k * away;
  for (int i = 0; i < 4; ++i) for (int j = 0; j < 4; ++j) P[4 * i + j] -= hP[i] * k * hP[j];
};
auto smooth = [&]() {  // forward, then back: Bryson and Frazier, no inverse
  const int n = (int)h.count;
  D m[4], P[16];
  for (int i = 0; i < 4; ++i) m[i] = h.mean[i];
  for (int i = 0; i < 16; ++i) P[i] = h.cov[i];
  for (int k = 0; k < n; ++k) {
    Node& a = node(k);
    if (k) onward(a, h.tooth2, m, P);
    for (int i = 0; i < 4; ++i) a.before[i] = m[i];
    for (int i = 0; i < 16; ++i) a.cover[i] = P[i];
    given_site(a, m, P);
  }
  D z[4] = {}, Z[16] = {};
  for (int k = n - 1; k >= 0; --k) {
    Node& a = node(k);
    const D* Q = a.cover;
    if (a.prec >= 1e-6) {
      D hP[4];
      for (int i = 0; i < 4; ++i) hP[i] = Q[4 * i] + Q[4 * i + 3];
      const D inv = 1.0 / (hP[0] + hP[3] + 1.0 / a.prec), away = a.eta / a.prec - a.before[0] - a.before[3];
      // C = I - K H, K = hP inv, H = (1 0 0 1): C' z = z - H (K z)
      D kz = 0.0, ZK[4] = {}, kk = 0.0;
      for (int i = 0; i < 4; ++i) kz += hP[i] * inv * z[i];
      for (int i = 0; i < 4; ++i) for (int j = 0; j < 4; ++j) ZK[i] += Z[4 * i + j] * hP[j] * inv;
      for (int i = 0; i < 4; ++i) kk += hP[i] * inv * ZK[i];
      for (int i = 0; i < 4; i += 3) z[i] -= kz + inv * away;
      for (int i = 0; i < 4; ++i)
        for (int j = 0; j < 4; ++j)
          Z[4 * i + j] += (i % 3 ? 0.0 : -ZK[j]) + (j % 3 ? 0.0 : -ZK[i]) + (i % 3 || j % 3 ? 0.0 : kk + inv);
    }
    for (int i = 0; i < 4; ++i) {
      a.mean[i] = a.before[i];
      for (int j = 0; j < 4; ++j) a.mean[i] -= Q[4 * i + j] * z[j];
    }
    D QZ[16] = {};
    for (int i = 0; i < 4; ++i) for (int j = 0; j < 4; ++j) for (int l = 0; l < 4; ++l) QZ[4 * i + j] += Q[4 * i + l] * Z[4 * l + j];
    for (int i = 0; i < 4; ++i)
      for (int j = 0; j < 4; ++j) {
        D v = Q[4 * i + j];
        for (int l = 0; l < 4; ++l) v -= QZ[4 * i + l] * Q[4 * l + j];
        a.cov[4 * i + j] = v;
      }
    if (k + 1 < n) {  // steps of the bend after Student: its variance given the step
      Node& b = node(k + 1);
      b.gust = (p.bend_tail * sq(p.bend) + sq(b.mean[2] - a.mean[2]) / STEP) / (p.bend_tail + 1.0);
    }
    if (k) {
      const D t = a.a, q = 0.5 * t * t, r = ::exp(-t / p.tooth_m);
      z[2] += t * z[1] + q * z[0], z[1] += t * z[0], z[3] *= r;
      for (int j = 0; j < 4; ++j) Z[8 + j] += t * Z[4 + j] + q * Z[j], Z[4 + j] += t * Z[j], Z[12 + j] *= r;
      for (int i = 0; i < 16; i += 4) Z[i + 2] += t * Z[i + 1] + q * Z[i], Z[i + 1] += t * Z[i], Z[i + 3] *= r;
    }
  }
};

// ---- Rays
auto put = [](float* row, int cells, D first, D width, D b, D amount) {
  const D v = (b - first) / width - 0.5;
  if (!(v >= 0.0 && v < cells - 1)) return;
  const int i = (int)v;
  row[i] += (float)(amount * (1.0 - (v - i))), row[i + 1] += (float)(amount * (v - i));
};
auto reaches = [&]() {  // whether rays come to the ground beyond the last node
  const Node& a = node((int)h.count - 1);
  const D c = ::cos(a.phi - h.psi), d = ::sin(a.phi - h.psi), cp = ::cos(h.psi), sp = ::sin(h.psi);
  const D x0 = cp * (a.x - h.X) + sp * (a.u - h.U), u0 = cp * (a.u - h.U) - sp * (a.x - h.X);
  int beyond = 0;
  for (int i = 0; i < (int)g.beams; ++i) {
    const D *v = aim.data + 3 * i, r = v[2] < -0.05 ? (s.lowest - s.z) / v[2] : MANY;
    if (r > 20.0) continue;
    const D x = s.x + r * v[0] - x0, u = s.y + r * v[1] - u0, b = c * u - d * x;
    if (c * x + d * u > 0.5 * STEP && b > -1.5 && b < 1.5 && ++beyond >= 3) return true;
  }
  return false;
};
auto take = [&]() {
  const int n = (int)g.beams, count = (int)h.count;
  D fx, fu, fphi;  // where the edge is expected beside the ground that is seen
  const D cp = ::cos(h.psi), sp = ::sin(h.psi);
  if (count) {
    int k = count - 1;
    while (k > 0 && node(k).scans < 0.3) --k;
    const Node& a = node(k);
    fx = a.x - ::sin(a.phi) * a.mean[0], fu = a.u + ::cos(a.phi) * a.mean[0], fphi = a.phi + a.mean[1];
  } else {
    fx = h.X + cp * s.reference - sp * s.centre, fu = h.U + sp * s.reference + cp * s.centre, fphi = h.psi;
  }
  const D fc = ::cos(fphi), fs = ::sin(fphi), high = count ? -0.25 : -p.search;
  struct Ray { D x, u, z, dx, du, dz, r; };
  auto ray = [&](int i) -> Ray {
    const D turn = g.rate * ago.data[i], c = cp - sp * turn, d = sp + cp * turn, back = g.speed * ago.data[i];
    const D *v = aim.data + 3 * i, r = ranges.data[i];
    return {h.X + back * cp + c * s.x - d * s.y, h.U + back * sp + d * s.x + c * s.y, s.z, c * v[0] - d * v[1], d * v[0] + c * v[1],
            v[2], r > 0.0 && r < 25.0 ? r : -1.0};
  };
  // the stubble side as a plane across, the plane before as prior
  D level = h.level, slope = h.slope;
  for (int round = 0; round < 2; ++round) {
    const D first = h.known > 0.0 ? 1.0 : 0.2;
    D s0 = 6.0 * first, s1 = 0.0, s2 = 60.0 * first, t0 = 6.0 * first * h.level, t1 = 60.0 * first * h.slope, close = 0.0, seen = 0.0, low = 0.0;
    for (int i = 0; i < n; ++i) {
      if (!(aim.data[3 * i + 2] < -0.05)) continue;
      const Ray q = ray(i);
      if (q.r < 1.5) continue;
      const D x = q.x + q.r * q.dx - fx, u = q.u + q.r * q.du - fu, z = q.z + q.r * q.dz, b = fc * u - fs * x;
      if (b < -3.5 || b > high || z > 1.0 || z < -4.0) continue;
      const D away = z - level - slope * b;
      seen += 1.0, low += z;
      if (away > 0.6 || away < -0.6) continue;
      close += 1.0;
      const D w = 1.0 / sq(1.0 + sq(away / 0.08));
      s0 += w, s1 += w * b, s2 += w * b * b, t0 += w * z, t1 += w * b * z;
    }
    if (close < 5.0) {
      if (seen >= 20.0) level = low / seen, slope = 0.0, h.level = level, h.slope = 0.0;
      continue;
    }
    const D det = s0 * s2 - s1 * s1;
    level = (s2 * t0 - s1 * t1) / det, slope = clip((s0 * t1 - s1 * t0) / det, -0.3, 0.3);
    if (round) h.known = 1.0;
  }
  h.level = level, h.slope = slope;
  int at = count - 1;
  D said[NODES] = {}, whole = 0.0, cosine[NODES], sine[NODES], node_x[NODES], node_u[NODES];
  float* of[NODES];
  for (int k = 0; k < count; ++k) {
    const Node& a = node(k);
    cosine[k] = ::cos(a.phi), sine[k] = ::sin(a.phi), node_x[k] = a.x, node_u[k] = a.u, of[k] = grid(k);
  }
  const D top = s.lowest + L * s.layer;
  for (int i = 0; i < n; ++i) {
    if (!(aim.data[3 * i + 2] < -0.05)) continue;
    const Ray q = ray(i);
    const D b0 = fc * (q.u - fu) - fs * (q.x - fx), db = fc * q.du - fs * q.dx;
    const D h0 = q.z - level - slope * b0, dh = q.dz - slope * db;
    if (!(dh < -LEVEL)) continue;
    const bool seen = q.r > 0.0;
    const D end = seen ? h0 + q.r * dh : 0.0;
    if (seen && (q.r < 1.0 || end > top)) continue;  // dust
    D px, pu, along, beside = 0.0;
    auto locate = [&](D r) {  // node and place beside it of a point of the ray; less how far upright crop seems to lean there
      const D z = h0 + r * dh, aside = g.rise * (z > 0.0 ? z : 0.0);
      px = q.x + r * q.dx + sp * aside, pu = q.u + r * q.du - cp * aside;
      if (!count) {
        const D x = px - fx, u = pu - fu;
        along = fc * x + fs * u, beside = fc * u - fs * x;
        return along > -3.0;
      }
      for (int round = 0; round < 8; ++round) {
        const D c = cosine[at], d = sine[at], x = px - node_x[at], u = pu - node_u[at];
        along = c * x + d * u, beside = c * u - d * x;
        const int go = along > 0.5 * STEP ? (int)(along / STEP + 0.5) : along < -0.5 * STEP ? -(int)(0.5 - along / STEP) : 0;
        const int to = at + go < 0 ? 0 : at + go >= count ? count - 1 : at + go;
        if (to == at) break;
        at = to;
      }
      return along > -0.6 * STEP && along < 0.6 * STEP;
    };
    if (count) {  // passes far beside the path from the crop's top to the ground
      constexpr D FAR = -E0 + K * CELL + 0.3;
      locate((top - h0) / dh);
      const D over = beside;
      locate((s.lowest - h0) / dh);
      if ((over > FAR && beside > FAR) || (over < -FAR && beside < -FAR)) continue;
    }
    if (locate((0.4 * s.usual - h0) / dh)) {
      float* rays = count ? of[at] + 2 * L * W : wide + 2 * L * S;
      const int next = count ? W : S;
      const D first = count ? E0 - K * CELL : W0, width = count ? CELL : WIDE;
      put(rays, next, first, width, beside, 1.0);
      if (!seen) put(rays + next, next, first, width, beside, 1.0);
      if (count && beside > -1.0 && beside < 1.0) said[at] += s.layer, whole += s.layer, h.touched = least(h.touched, at);
    }
    if (!seen) continue;
    const D reach = most(q.r - p.delay * h.free / h.over, 0.0);
    const bool is_stop = end > s.lowest;
    for (int l = L - 1; l >= 0; --l) {
      const D r0 = most((s.lowest + (l + 1) * s.layer - h0) / dh, 0.3), r1 = (s.lowest + l * s.layer - h0) / dh;
      if (r1 <= r0) continue;
      if (reach <= r0) break;
      const D stop = least(r1, reach);
      const int parts = 1 + (int)least((stop - r0) * (db < 0.0 ? -db : db) / CELL, 3.0);
      for (int j = 0; j < parts; ++j) {
        const D r = r0 + (stop - r0) * (j + 0.5) / parts, length = (stop - r0) / parts;
        if (!locate(r)) continue;
        if (count) {
          put(of[at] + L * W + l * W, W, E0 - K * CELL, CELL, beside, length);
          if (beside > -1.0 && beside < 1.0) said[at] += length, whole += length;
          if (at < h.touched) h.touched = at;
        } else {
          put(wide + L * S + l * S, S, W0, WIDE, beside, length);
        }
      }
      if (reach <= r1) {
        if (is_stop && locate(reach)) {
          if (count) put(of[at] + l * W, W, E0 - K * CELL, CELL, beside, 1.0);
          else put(wide + l * S, S, W0, WIDE, beside, 1.0);
        }
        break;
      }
    }
  }
  if (whole > 0.0) for (int k = 0; k < count; ++k) node(k).scans += said[k] / whole;
};

// ---- Rates of stops per metre on both sides; the shape of an edge
float up[L][2 * K], way_up[L][2 * K], full[L], way_full[L], ln_lost, ln_kept;
int none_to[L], all_from[L];  // cells of the template with nothing of the stand, and with all of it
auto shape = [&](const float* there) {  // what stops and metres say where a share of the stand is there, (L, 2 K)
  for (int l = 0; l < L; ++l) {
    const float more = (float)(h.mu_in[l] - h.mu_out[l]), per = (float)(1.0 / h.mu_out[l]), *of = there + l * 2 * K;
    int &lo = none_to[l] = 0, &hi = all_from[l] = 2 * K;
    while (lo < 2 * K && of[lo] == 0.0f) ++lo;
    while (hi > lo && of[hi - 1] > 0.9999f) --hi;
    for (int t = lo; t < hi; ++t) {
      const float w = more * of[t];
      up[l][t] = (float)::log((D)(1.0f + w * per)), way_up[l][t] = w;
    }
  }
};
auto add_shape = [&](D lean, D width, float worth, float* there) {
  for (int l = 0; l < L; ++l) {
    const float z = (float)(s.lowest + (l + 0.5) * s.layer), per = (float)(TABLE / 8.0 / width);
    for (int t = 0; t < 2 * K; ++t) {
      const float v = ((t - K + 0.5f) * (float)CELL - (float)lean * z) * per + 0.5f * TABLE;
      there[l * 2 * K + t] += worth * (v < 0.0f ? 0.0f : v >= TABLE ? 1.0f : normal[(int)v]);
    }
  }
};
auto weigh_shapes = [&]() {
  D best = -1e30, sum = 0.0, v[SHAPES];
  for (int f = LEANS; f < SHAPES; ++f) best = most(best, v[f] = h.said[f] / p.shape_alike);
  for (int f = LEANS; f < SHAPES; ++f) sum += h.chance[f] = ::exp(v[f] - best);
  for (int f = LEANS; f < SHAPES; ++f) h.chance[f] /= sum;
  best = -1e30, sum = 0.0;
  for (int f = 0; f < LEANS; ++f) {
    D chance = 0.0;  // over how far it leans along the edge, too: it is lower then
    for (int g = 0; g < LEANS; ++g) {
      const D lean2 = sq(LEAN[f]) + sq(LEAN[g]), a = 1.0 + lean2 / sq(p.lean_sd);
      const D b = s.is_usual > 0.0 ? 1.0 + 0.5 * sq((h.height / s.usual * ::sqrt(1.0 + lean2) - 1.0) / p.height_sd) : 1.0;
      chance += 1.0 / (a * b * ::sqrt(a * b));
    }
    v[f] = ::log(chance) + h.said[f] / p.shape_alike;
    best = most(best, v[f]);
  }
  for (int f = 0; f < LEANS; ++f) sum += h.chance[f] = ::exp(v[f] - best);
  for (int f = 0; f < LEANS; ++f) h.chance[f] /= sum;
};
auto rates = [&](const Rates& in, const Rates& away) {
  D mean = 4.0 * p.least;  // crop that is not seen is as dense as the layer above it
  for (int l = L - 1; l >= 0; --l) {
    mean = h.mu_in[l] = most((in.n[l] + p.prior * mean) / (in.x[l] + p.prior), 4.0 * p.least);
    h.mu_out[l] = (away.n[l] + p.prior * p.least) / (away.x[l] + p.prior) + p.least;
    full[l] = (float)::log(h.mu_in[l] / h.mu_out[l]), way_full[l] = (float)(h.mu_in[l] - h.mu_out[l]);
  }
  weigh_shapes();
  float there[L * 2 * K] = {};
  for (int f = 0; f < LEANS; ++f)
    for (int w = 0; w < WIDTHS; ++w) {
      const D c = h.chance[f] * h.chance[LEANS + w];
      if (c > RARE) add_shape(LEAN[f], WIDTH[w], (float)c, there);
    }
  shape(there);
  h.q_in = (in.lost + 0.5) / (in.rays + 10.0), h.q_out = (away.lost + 0.5) / (away.rays + 10.0);
  ln_lost = (float)::log(h.q_in / h.q_out), ln_kept = (float)::log((1.0 - h.q_in) / (1.0 - h.q_out));
};
auto score_of = [&](int k, float* to) {  // log-likelihood of the wall at every place
  float *q = grid(k), score[C + 1];
  for (int j = 0; j <= C; ++j) score[j] = 0.0f;
  for (int l = 0; l < L; ++l) {
    const float *n = q + l * W, *x = q + L * W + l * W;
    float any = 0.0f;
    for (int i = 0; i < W; ++i) any += x[i];
    if (any == 0.0f) continue;
    for (int t = none_to[l]; t < all_from[l]; ++t) {
      const float a = up[l][t], b = way_up[l][t];
      for (int j = 0; j <= C - 1; ++j) score[j] += n[j + t] * a - x[j + t] * b;
      if (C + t < W) score[C] += n[C + t] * a - x[C + t] * b;
    }
    float sum = 0.0f;  // cells further in
    for (int j = W - all_from[l] - 1; j >= 0; --j) {
      sum += n[j + all_from[l]] * full[l] - x[j + all_from[l]] * way_full[l];
      if (j <= C) score[j] += sum;
    }
  }
  const float *rays = q + 2 * L * W, *lost = rays + W;
  float sum = 0.0f;
  for (int j = W - 1; j >= K; --j) {
    sum += lost[j] * ln_lost + (rays[j] - lost[j]) * ln_kept;
    if (j - K <= C) score[j - K] += sum;
  }
  const float per = (float)(1.0 / h.over);
  for (int j = 0; j <= C; ++j) to[j] = score[j] * per;
};

auto add_sides = [&](int k, Rates& in, Rates& away, D worth) {  // what was seen clearly on either side of a node's wall
  const Node& a = node(k);
  const float *q = grid(k), *rays = q + 2 * L * W, *lost = rays + W;
  const D e = a.mean[0] + a.mean[3], sd = ::sqrt(most(a.cov[0] + 2.0 * a.cov[3] + a.cov[15], 0.0));
  if (sd > 0.4) return;
  const int from = (int)clip((e + 0.2 + 2.0 * sd - E0) / CELL + K + 1, 0, W), to = (int)clip((e - 0.2 - 2.0 * sd - E0) / CELL + K, 0, W);
  for (int l = 0; l < L; ++l) {
    const float *n = q + l * W, *x = q + L * W + l * W;
    float sn = 0.0f, sx = 0.0f, on = 0.0f, ox = 0.0f;
    for (int i = from; i < W; ++i) sn += n[i], sx += x[i];
    for (int i = 0; i < to; ++i) on += n[i], ox += x[i];
    in.n[l] += worth * sn, in.x[l] += worth * sx, away.n[l] += worth * on, away.x[l] += worth * ox;
  }
  for (int i = from; i < W; ++i) in.lost += worth * lost[i], in.rays += worth * rays[i];
  for (int i = 0; i < to; ++i) away.lost += worth * lost[i], away.rays += worth * rays[i];
};
auto along_rows = [&](D angle) {  // 1 where the line runs along the rows, 0 where it crosses them within a tooth
  return s.rows > 0.0 ? 1.0 / (1.0 + sq(p.tooth_m * ::sin(angle - h.row_angle) / s.rows)) : 0.0;
};
auto learn_rows = [&](const Node& a, const float* q) {
  const D angle = a.phi + a.mean[1], e = a.mean[0] + a.mean[3];
  if (h.row_seen == 0.0) h.row_angle = angle;
  const D along = along_rows(angle), keep = ::exp(-STEP / p.memory);
  h.row_seen = h.row_seen * keep + along;
  h.row_angle += along / h.row_seen * (angle - h.row_angle);
  for (int i = 0; i < BINS; ++i) h.row_n[i] *= keep, h.row_x[i] *= keep;
  for (int i = 0; i < W; ++i) {
    const D d = (E0 + (i - K + 0.5) * CELL - e) / s.rows;
    if (d < 0.0) continue;
    const int bin = (int)((d - (int)d) * BINS);
    for (int l = 0; l < L; ++l) h.row_n[bin] += along * q[l * W + i], h.row_x[bin] += along * q[L * W + l * W + i];
  }
};
auto row_behind = [&](D& seen) {  // how far behind the wall the outermost row stands, and how plainly it is seen, 0..1
  D re = 0.0, im = 0.0, sum = 0.0;
  for (int i = 0; i < BINS; ++i) {
    const D rate = h.row_n[i] / (h.row_x[i] + p.prior), t = 6.283185307179586 * (i + 0.5) / BINS;
    re += rate * ::cos(t), im += rate * ::sin(t), sum += rate;
  }
  seen = sum > 0.0 ? (sq(re) + sq(im)) / sq(sum) : 0.0;
  const D phase = ::atan2(im, re) / 6.283185307179586;
  return s.rows * (phase < -BEFORE ? phase + 1.0 : phase);
};
auto is_clear = [&](const Node& a) { return a.standing > 0.9 && a.prec > 1.0 / sq(p.clear); };  // an edge, and seen from both sides
auto learn = [&](int k) {  // from a node that no ray reaches any more
  Node& a = node(k);
  a.learned = 1.0;
  if (a.scans <= 0.0) return;
  const D keep = ::exp(-STEP / p.memory), share = most(1.0 - keep, 1.0 / (h.learned + 5.0));
  h.learned += 1.0;
  Rates* both[2] = {&h.in, &h.out};
  for (Rates* r : both) {
    for (int l = 0; l < L; ++l) r->n[l] *= keep, r->x[l] *= keep;
    r->lost *= keep, r->rays *= keep;
  }
  if (!is_clear(a)) return;
  add_sides(k, h.in, h.out, a.standing);
  if (s.rows > 0.0) learn_rows(a, grid(k));
  h.tooth2 = most(h.tooth2 + share * (sq(a.mean[3]) + a.cov[15] - h.tooth2), sq(p.tooth));
  // the shape of the edge: how well each explains this node, wherever it puts the feet
  int lean = 0, width = 0;
  for (int f = 1; f < LEANS; ++f) lean = h.chance[f] > h.chance[lean] ? f : lean;
  for (int w = 1; w < WIDTHS; ++w) width = h.chance[LEANS + w] > h.chance[LEANS + width] ? w : width;
  for (int f = 0; f < SHAPES; ++f) {
    float to[C + 1], there[L * 2 * K] = {};
    add_shape(LEAN[f < LEANS ? f : lean], WIDTH[f < LEANS ? width : f - LEANS], 1.0f, there);
    shape(there);
    score_of(k, to);
    float top = to[0];
    for (int j = 1; j <= C; ++j) top = to[j] > top ? to[j] : top;
    D sum = 0.0, at = 0.0;
    for (int j = 0; j <= C; ++j) {
      const D v = to[j] - top > -20.0f ? ::exp((D)(to[j] - top)) : 0.0;
      sum += v, at += v * (E0 + j * CELL);
    }
    h.said[f] = h.said[f] * keep + top + ::log(sum);
    at /= sum;
    h.aside[f] += most(share, 1.0 / h.learned) * ((at - (a.mean[0] + a.mean[3])) - h.aside[f]);
  }
  for (int first = 0; first < SHAPES; first += LEANS) {
    const int end = first ? SHAPES : LEANS;
    D highest = h.said[first];
    for (int f = first; f < end; ++f) highest = most(highest, h.said[f]);
    for (int f = first; f < end; ++f) h.said[f] -= highest;
  }
  // how much more stops scatter from place to place than those of a Poisson process
  const float* q = grid(k);
  const D e = a.mean[0] + a.mean[3];
  const int first = (int)((e + 0.3 - E0) / CELL) + K;
  D chi = 0.0, count = 0.0;
  for (int block = 0; block < 4; ++block) {
    const int from = first + 6 * block;
    if (from < 0 || from + 6 > W) continue;
    D stops = 0.0, wanted = 0.0;
    for (int l = 0; l < L; ++l)
      for (int i = from; i < from + 6; ++i) stops += q[l * W + i], wanted += h.mu_in[l] * q[L * W + l * W + i];
    if (wanted > 1.0) chi += sq(stops - wanted) / wanted, count += 1.0;
  }
  if (count > 0.0) h.over = most(h.over + share * count / 4.0 * (least(chi / count, 50.0) - h.over), 1.0);
};
auto measure = [&]() {  // how far rays come; height below which most of what stops rays in the crop lies
  D sum = 0.0, so_far = 0.0, n[L];
  for (int l = 0; l < L; ++l) sum += n[l] = most(h.mu_in[l] - h.mu_out[l], 0.0) / h.mu_in[l] * h.in.n[l];
  if (sum < 1.0) return;
  D rate = 0.0;
  for (int l = 0; l < L; ++l) rate += n[l] / sum * h.mu_in[l];
  h.free = least(1.0 / rate, FARTHEST);
  for (int l = 0; l < L; ++l) {
    if (so_far + n[l] >= 0.9 * sum) {
      h.height = s.lowest + (l + (0.9 * sum - so_far) / n[l]) * s.layer;
      return;
    }
    so_far += n[l];
  }
};

// ---- One round: what each node's rays say, given what the others say
auto hear = [&](int k) {
  Node& a = node(k);
  float *q = grid(k), *score = q + 2 * L * W + 2 * W, *wall = score + C + 1, *like = wall + C + 1;
  float before[C + 1], joint[C + 2];
  // in a hole: a wall anywhere, that goes on from node to node, or none near (the last of the places)
  const float* last = k ? grid(k - 1) + 2 * L * W + 2 * W + C + 1 : nullptr;
  const D shift = k ? a.b / CELL : 0.0;  // the path steps aside
  float near = 0.0f;
  for (int j = 0; j < C; ++j) {
    const D v = j + shift;
    const int i = (int)(v < 0.0 ? v - 1.0 : v);
    const D f = v - i;
    before[j] = !last ? 1.0f / (C + 1) : i >= 0 && i < C ? (float)((1.0 - f) * last[i] + (i + 1 < C ? f * last[i + 1] : 0.0)) : 0.0f;
    near += before[j];
  }
  before[C] = near < 1.0f ? 1.0f - near : 0.0f;
  const float r = (float)::exp(-CELL / p.wall_step), gain = (1.0f - r) / (1.0f + r);
  float ahead[C];
  ahead[0] = before[0];
  for (int j = 1; j < C; ++j) ahead[j] = before[j] + r * ahead[j - 1];
  const float stays = (float)p.wall_stays, any = (float)(1.0 - p.wall_stays - p.wall_none) / (C + 1);
  float back = 0.0f, total = 0.0f;
  for (int j = C - 1; j >= 0; --j) {
    joint[j] = stays * gain * (ahead[j] + r * back) + any;
    back = before[j] + r * back;
  }
  joint[C] = stays * before[C] + any + (float)p.wall_none;
  for (int j = 0; j <= C; ++j) joint[j] *= like[j], total += joint[j];
  for (int j = 0; j <= C; ++j) wall[j] = joint[j] / (total > 1e-30f ? total : 1e-30f);
  float below[C + 2];
  below[0] = 0.0f;
  for (int j = 0; j <= C; ++j) below[j + 1] = below[j] + joint[j];
  const int apart = (int)(p.apart / CELL);
  // the rest says where the wall is: mean c, variance v
  const D vs = most(a.cov[0] + 2.0 * a.cov[3] + a.cov[15], 1e-8), ms = a.mean[0] + a.mean[3];
  const D rest = most(1.0 / vs - a.prec, 1e-4), v = 1.0 / rest, c = (ms / vs - a.eta) * v, sd = ::sqrt(v);
  const D from = most(c - 4.0 * sd, 2.0 * E0), to = least(c + 4.0 * sd, -2.0 * E0);
  if (!(to > from)) {
    a.eta = a.prec = 0.0, a.edge = 1e-6, a.hole = most(total, 1e-6);
    return;
  }
  const D width = least(CELL, (to - from) / 24.0);
  const int count = (int)((to - from) / width);
  D z = 0.0, z1 = 0.0, z2 = 0.0, edge = 0.0, hole = 0.0, is_edge = a.pi, norm = 0.0;
  for (int i = 0; i <= count; ++i) {
    const D e = from + i * width, at = (e - E0) / CELL;
    const int j = (int)clip(at, 0.0, C - 1.0);
    const D f = most(at - j, 0.0), w = ::exp(-0.5 * sq(e - c) * rest);
    const D ln = (1.0 - f) * score[j] + f * score[j + 1], lk = f > 1.0 ? like[C] : ln > -40.0 ? ::exp(ln) : 0.0;
    const D free = total - below[(int)clip(at + apart + 1.0, 0.0, C)];
    const D t = w * (is_edge * lk + (1.0 - is_edge) * free);
    edge += w * lk, hole += w * free, norm += w;
    z += t, z1 += t * (e - c), z2 += t * sq(e - c);
  }
  if (!(norm > 0.0)) return;
  a.edge = most(edge / norm, 1e-12), a.hole = most(hole / norm, 1e-12);
  if (!(z > 0.0)) {
    a.eta = a.prec = 0.0;
    return;
  }
  const D mean = z1 / z, var = most(z2 / z - sq(mean), sq(0.3 * width));
  const D prec = clip(1.0 / var - rest, 0.0, 1e5);
  a.prec = prec, a.eta = prec > 0.0 ? (prec + rest) * (c + mean) - rest * c : 0.0;
};
auto modes = [&]() {  // edge or hole, forward and back; pi leaves out the node's own rays
  const int n = (int)h.count;
  D f = h.alpha;
  for (int k = 0; k < n; ++k) {
    Node& a = node(k);
    if (k) f = f * (1.0 - p.hole) + (1.0 - f) * p.hole_ends;
    a.pi = f;
    const D e = f * a.edge, o = (1.0 - f) * a.hole;
    f = clip(e / most(e + o, 1e-300), 1e-9, 1.0 - 1e-9);
  }
  D be = 1.0, bo = 1.0;
  for (int k = n - 1; k >= 0; --k) {
    Node& a = node(k);
    const D e = a.pi * be, o = (1.0 - a.pi) * bo;
    a.pi = clip(e / (e + o), 1e-6, 1.0 - 1e-6);
    const D pe = a.pi * a.edge, po = (1.0 - a.pi) * a.hole;
    a.standing = pe / (pe + po);
    const D ge = be * a.edge, go = bo * a.hole;
    be = (1.0 - p.hole) * ge + p.hole * go, bo = p.hole_ends * ge + (1.0 - p.hole_ends) * go;
    const D sum = be + bo;
    be /= sum, bo /= sum;
  }
};
auto update = [&]() {
  const int n = (int)h.count, touched = (int)least(h.touched, n);
  int from = touched;
  Rates in = h.in, away = h.out;
  for (int k = 0; k < n; ++k) if (node(k).learned == 0.0 && is_clear(node(k))) add_sides(k, in, away, node(k).standing);
  rates(in, away);
  measure();
  D lean = 0.0, width = 0.0;
  for (int f = 0; f < LEANS; ++f) lean += h.chance[f] * LEAN[f];
  for (int w = 0; w < WIDTHS; ++w) width += h.chance[LEANS + w] * WIDTH[w];
  if (sq(lean - h.lean) + sq(width - h.width) > sq(SAME)) from = 0, h.lean = lean, h.width = width;
  for (int k = from; k < n; ++k) {
    if (!(node(k).scans > 0.0)) continue;
    float *score = grid(k) + 2 * L * W + 2 * W, *like = score + 2 * (C + 1), best = 0.0f;  // of no crop at all
    score_of(k, score);
    for (int j = 0; j <= C; ++j) best = score[j] > best ? score[j] : best;
    for (int j = 0; j <= C; ++j) score[j] -= best, like[j] = score[j] > -40.0f ? (float)::exp((D)score[j]) : 0.0f;
    like[C] = best < 40.0f ? (float)::exp(-(D)best) : 0.0f;
  }
  for (int sweep = 0; sweep < 2; ++sweep) {
    smooth();
    for (int k = most(from - 4, 0); k < n; ++k) if (node(k).scans > 0.0) hear(k);
    modes();
  }
  smooth();
  for (int k = 0; k < touched; ++k) if (node(k).learned == 0.0) learn(k);
  h.touched = MANY, h.since = 0.0;
  while (h.count > 12.0) {  // the path's end is laid anew from what is believed by now where it is off, or was not seen
    const Node& a = node((int)h.count - 1);
    if (a.scans >= 1.0 || (a.scans >= 0.02 && sq(a.mean[0]) < sq(0.5) && sq(a.mean[1]) < sq(0.2))) break;
    h.count -= 1.0;
  }
  // what lies behind goes into what is believed before the first node's rays
  const D c = ::cos(h.psi), d = ::sin(h.psi);
  while (h.count > 3.0) {
    const Node& b = node(1);
    if (c * (b.x - h.X) + d * (b.u - h.U) > s.reference - 4.0) break;
    Node& a = node(0);
    if (a.learned == 0.0) learn(0);
    given_site(a, h.mean, h.cov);
    const D e = h.alpha * a.edge, o = (1.0 - h.alpha) * a.hole, f = e / most(e + o, 1e-300);
    onward(b, h.tooth2, h.mean, h.cov);
    h.alpha = clip(f * (1.0 - p.hole) + (1.0 - f) * p.hole_ends, 1e-9, 1.0 - 1e-9);
    h.first = ((int)h.first + 1) % NODES, h.count -= 1.0;
  }
};

// ---- The start: two sides anywhere near the header end, in the rays of the last metres
auto begin = [&]() {
  float *n = wide, *x = wide + L * S, *rays = wide + 2 * L * S, *lost = rays + S;
  D gain[S + 1] = {};
  auto entropy = [&](D a, D b) { return a > 0.0 ? a * ::log(a / most(b, 0.05)) : 0.0; };
  D stops_out[S + 1] = {}, way_out[S + 1] = {}, stops_all = 0.0, way_all = 0.0;
  for (int l = 1; l <= L; ++l) {  // not the lowest, stubble; the last: lost rays
    const float *a = l < L ? n + l * S : lost, *b = l < L ? x + l * S : rays;
    D sa = 0.0, sb = 0.0, ta = 0.0, tb = 0.0;
    for (int i = 0; i < S; ++i) sa += a[i], sb += b[i];
    for (int i = 0; i <= S; ++i) {
      const D more = ta * (sb - tb) < (sa - ta) * tb ? 1.0 : -1.0;  // inside more than outside
      gain[i] += (l < L ? more : -more) * (entropy(ta, tb) + entropy(sa - ta, sb - tb) - entropy(sa, sb));
      if (l < L) stops_out[i] += ta, way_out[i] += tb;
      if (i < S) ta += a[i], tb += b[i];
    }
    if (l < L) stops_all += sa, way_all += sb;
  }
  const D alike = most(1.0, h.scans / (1.0 + h.way / 0.24));
  int best = -1;
  D most_gain = p.begin_nat;
  for (int i = 5; i <= S - 5; ++i) {
    const D e = W0 + i * WIDE, v = gain[i] / alike - 0.5 * sq(e / p.search);
    const bool is_denser = (stops_all - stops_out[i]) * way_out[i] > p.denser * stops_out[i] * (way_all - way_out[i]);
    if (v > most_gain && is_denser) most_gain = v, best = i;
  }
  if (best < 0) return;
  const D e = W0 + best * WIDE;
  for (int l = 0; l <= L; ++l)
    for (int i = 0; i < S; ++i) {
      const D d = W0 + (i + 0.5) * WIDE - e, w = 1.0 / alike;
      if (d > -0.3 && d < 0.3) continue;
      Rates& r = d > 0.0 ? h.in : h.out;
      if (l < L) r.n[l] += w * n[l * S + i], r.x[l] += w * x[l * S + i];
      else r.lost += w * lost[i], r.rays += w * rays[i];
    }
  rates(h.in, h.out);
  measure();
  const D c = ::cos(h.psi), d = ::sin(h.psi), ahead = s.reference - 1.0, aside = s.centre + e;
  h.count = 1.0, h.first = 0.0, h.alpha = 0.9, h.touched = 0.0;
  Node& a = node(0);
  renew(a, nullptr);
  wipe(0);
  a.x = h.X + c * ahead - d * aside, a.u = h.U + d * ahead + c * aside, a.phi = h.psi, a.bend = a.a = a.b = a.turn = 0.0;
  for (int i = 0; i < 4; ++i) h.mean[i] = 0.0;
  for (int i = 0; i < 16; ++i) h.cov[i] = 0.0;
  h.cov[0] = sq(0.4), h.cov[5] = sq(p.turn_sd), h.cov[10] = sq(p.bend_sd), h.cov[15] = h.tooth2;
};
auto extend = [&]() {
  const int k = (int)h.count;
  if (k >= NODES) return;
  h.count += 1.0;
  renew(node(k), &node(k - 1));
  wipe(k);
};

if (h.over == 0.0) lose();
if (g.is_new > 0.0) {
  D x, u, psi;
  moved(g.seconds, x, u, psi);
  h.X = x, h.U = u, h.psi = psi;
  const D travel = (g.speed < 0.0 ? -g.speed : g.speed) * g.seconds;
  h.since += travel;
  if (h.count == 0.0) {
    const float keep = (float)::exp(-travel / p.begin_m);
    for (int i = 0; i < 2 * L * S + 2 * S; ++i) wide[i] *= keep;
    h.way = h.way * keep + travel, h.scans = h.scans * keep + 1.0;
    take();
    if (h.since >= 0.5 * STEP) h.since = 0.0, begin();
  } else {
    while (h.count < 12.0) extend();
    for (int round = 0; round < 30 && reaches() && h.count < NODES; ++round) extend();
    take();
    if (h.since >= 0.75 * STEP && h.touched < MANY) update();
  }
}

// ---- What is told, of where the machine is by now
for (int i = 0; i < 10; ++i) out[i] = __builtin_nan("");
out[0] = 0.0;
if (h.count >= 3.0) {
  D X, U, psi;
  moved(g.age, X, U, psi);
  const D c = ::cos(psi), d = ::sin(psi);
  const int n = (int)h.count;
  int near = 0;
  D nearest = 1e30, farthest = -1e30;
  int last = -1;
  bool is_lost = false;
  for (int k = 0; k < n; ++k) {
    const Node& a = node(k);
    const D x = a.x - ::sin(a.phi) * a.mean[0] - X, u = a.u + ::cos(a.phi) * a.mean[0] - U, ahead = c * x + d * u;
    const D away = ahead - s.reference < 0.0 ? s.reference - ahead : ahead - s.reference;
    if (away < nearest) nearest = away, near = k;
    if (a.standing > 0.5 && a.scans > 0.2 && a.prec > 1.0) farthest = most(farthest, ahead), last = k;
  }
  if (last >= 0) {
    const Node& a = node(near);
    const D x = a.x - ::sin(a.phi) * a.mean[0] - X, u = a.u + ::cos(a.phi) * a.mean[0] - U;
    const D ahead = c * x + d * u, beside = c * u - d * x, angle = a.phi + a.mean[1] - psi;
    const D steep = most(::cos(angle), 0.2), way = (s.reference - ahead) / steep, q = 0.5 * way * way;
    const D heading = angle + way * a.mean[2];
    const D offset = beside + way * ::sin(angle) + q * a.mean[2] * steep;
    const D J[3] = {1.0, way, q};
    D var = 0.0;
    for (int i = 0; i < 3; ++i) for (int j = 0; j < 3; ++j) var += J[i] * J[j] * a.cov[4 * i + j];
    const D size = way < 0.0 ? -way : way;
    var += sq(p.turn) * size * size * size / 3.0 + sq(p.bend) * size * size * size * size * size / 20.0;
    for (int first = 0; first < SHAPES; first += LEANS) {  // where shapes put the feet
      D middle = 0.0;
      for (int f = first; f < (first ? SHAPES : LEANS); ++f) middle += h.chance[f] * h.aside[f];
      for (int f = first; f < (first ? SHAPES : LEANS); ++f) var += h.chance[f] * sq(h.aside[f] - middle);
    }
    D lean2 = 0.0;  // and how far a side that leans is from a plane
    for (int f = 0; f < LEANS; ++f) lean2 += h.chance[f] * sq(LEAN[f]);
    var += lean2 * sq(p.misfit * h.height);
    var += sq(p.drift * most(farthest - s.reference, 0.0));
    D row = 0.0;
    if (s.rows > 0.0) {  // the edge lies half a spacing outside the outermost row
      D seen, behind = row_behind(seen);
      seen = seen / (seen + sq(p.row_seen));
      const D along = along_rows(angle);
      row = along * (seen * behind - 0.5 * s.rows);
      var += along * (1.0 - along) * sq(0.5 * s.rows) + along * seen * (1.0 - seen) * sq(behind);
    }
    const D sd = ::sqrt(most(var, 0.0)) / steep;
    is_lost = sd > p.lost && nearest < 1.0 && a.scans > 0.2;
    if (sd < p.lost && farthest > s.reference - p.hold) {
      out[0] = 1.0, out[1] = offset + row / steep, out[2] = heading, out[3] = a.mean[2];
      out[4] = erf_(0.1 / (sd * 1.4142135623730951)) * 0.5 * (1.0 + a.standing);  // what looks like a hole may as well be the edge gone aside
      out[5] = h.height, out[6] = sd, out[7] = ::sqrt(a.cov[5] + size * sq(p.turn));
      out[8] = farthest, out[9] = a.standing < 0.5 || nearest > 1.0 ? 1.0 : 0.0;
    }
  }
  if (is_lost || (last < 0 ? n > 40 : farthest < s.reference - p.hold)) lose();
}
