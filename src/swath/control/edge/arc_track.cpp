// The edge as an arc that grows with the travel: where it will be a little further ahead.
//
// All in a frame at rest on the ground, (x, u), which dead reckoning keeps. The state is a point of the arc, its angle and its
// bend; a Kalman filter over the distance along the arc takes one block after another. Earlier states are kept: where an edge
// breaks off, the blocks just before the break were already wrong, and the track goes back behind them.
constexpr D BEND_STEP = 0.02, ANGLE_STEP = 0.01;  // 1/m and rad per sqrt(m): how fast the bend of an edge changes, of a ragged one
constexpr D CLIP = 2.0, MOST_BENT = 0.2;  // standard deviations that an innovation may count; 1/m

struct EdgeFrame {  // an arc in the machine's (x, u): a point on it [m], its angle [rad] and bend [1/m] there
  D x, u, angle, bend;
};
struct At {  // a machine at x, u [m] with a heading [rad], in the frame at rest
  D x, u, heading;
};

// x, u: a point [m] of the edge, its angle [rad] and bend [1/m], their covariance (beside, angle, bend); distance: along the edge
// from where it was first seen [m]; unseen: of it since the last block that fitted [m]
struct Arc : ArcRow {
  void begin(D at_x, D at_u, D at_angle, D at_bend, D at_distance = 0.0) {
    x = at_x, u = at_u, angle = at_angle, bend = at_bend, distance = at_distance, unseen = 0.0;
    for (int k = 0; k < 9; ++k) covariance[k] = 0.0;
    covariance[0] = 0.1 * 0.1, covariance[4] = 0.15 * 0.15, covariance[8] = 0.02 * 0.02;
  }
  // a distance [m] further on; unseen, its bend is taken to stay as it is
  __attribute__((noinline)) Arc ahead(D way, bool is_seen = true) const {
    const D f[9] = {1.0, way, 0.5 * way * way, 0.0, 1.0, way, 0.0, 0.0, 1.0};
    Arc on = *this;
    Np::transform(f, covariance, on.covariance);
    const D step = __builtin_fabs(way);
    on.covariance[0] += 1e-5 * step;
    if (is_seen) on.covariance[4] += ANGLE_STEP * ANGLE_STEP * step, on.covariance[8] += BEND_STEP * BEND_STEP * step;
    const D middle = angle + 0.5 * bend * way;
    on.x = x + way * ::cos(middle);
    on.u = u + way * ::sin(middle);
    on.angle = angle + bend * way;
    on.unseen = unseen + larger(way, 0.0);
    on.distance = distance + way;
    return on;
  }
  // after an edge was found `beside` it [m], with a variance [m2]; turns: of angle and bend, too
  __attribute__((noinline)) Arc corrected(D beside, D variance, bool turns = true) const {
    const D total = covariance[0] + variance, limit = CLIP * __builtin_sqrt(total);
    const D gain[3] = {covariance[0] / total, turns ? covariance[3] / total : 0.0, turns ? covariance[6] / total : 0.0};
    const D clipped = within(-limit, beside, limit);
    const D left[9] = {1.0 - gain[0], 0.0, 0.0, 0.0 - gain[1], 1.0, 0.0, 0.0 - gain[2], 0.0, 1.0};
    Arc on = *this;
    Np::transform(left, covariance, on.covariance);
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) on.covariance[3 * i + j] += variance * (gain[i] * gain[j]);
    on.x = x - gain[0] * clipped * ::sin(angle);
    on.u = u + gain[0] * clipped * ::cos(angle);
    on.angle = angle + gain[1] * clipped;
    on.bend = within(-MOST_BENT, bend + gain[2] * clipped, MOST_BENT);
    on.unseen = 0.0;
    return on;
  }
  void beside(D aside, D* at) const {  // a place x, u [m] beside its point [m]
    at[0] = x - aside * ::sin(angle);
    at[1] = u + aside * ::cos(angle);
  }
  EdgeFrame frame(D at_x, D at_u, D heading) const {  // in that of a machine at x, u [m] with a heading [rad]
    const D c = ::cos(heading), s = ::sin(heading), dx = x - at_x, du = u - at_u;
    return EdgeFrame{c * dx + s * du, c * du - s * dx, angle - heading, bend};
  }
};

struct ArcTrack : ArcTrackRow {  // an arc and what it was before, the newest KEPT
  void clear() { has_arc = past_count = 0.0; }
  void begin(const Arc& found) {
    clear();
    arc = found;
    has_arc = 1.0;
  }
  void keep(const Arc& old) { push((D*)past, past_count, sizeof(Arc) / sizeof(D), KEPT, (const D*)&old); }
  const Arc& last() const { return past[(int)past_count - 1]; }
  void accept(D beside, D variance, bool turns = true) {  // a block shows the edge `beside` the arc [m]; turns: and where it goes
    arc = arc.corrected(beside, variance, turns);
    keep(arc);
  }
  void advance(D distance) { arc = arc.ahead(distance, arc.unseen < 2.0); }  // the next block lies so far further on [m]
  // Back to before a distance along the edge [m], and from there on along the points seen since; noise: of all, beside their
  // own variance [m2]
  __attribute__((noinline)) void retrace(D distance, const EdgePoints& points, D noise) {
    const D now = arc.distance;
    while (past_count > 1.0 && last().distance >= distance - SAME) past_count -= 1.0;
    if (past_count == 0.0) return;
    Arc on = last();
    const D from = on.distance + SAME;
    for (int k = 0; k < points.count; ++k) {
      const D* p = points.row(k);
      if (!(p[DISTANCE] > from)) continue;
      on = on.ahead(-on.frame(p[0], p[1], on.angle).x);
      on.distance = p[DISTANCE];
      on = on.corrected(-on.frame(p[0], p[1], on.angle).u, p[VARIANCE] + noise);
      keep(on);
    }
    const D unseen = now - on.distance;
    arc = on;
    if (unseen > 0.0) {
      arc = on.ahead(unseen);
      arc.unseen = unseen;
    }
  }
  // back to before a distance along the edge [m], and on as an arc from where the last block fitted
  void rewind(const Arc& on, D distance) {
    while (past_count > 0.0 && last().distance > distance + SAME) past_count -= 1.0;
    arc = on;
    arc.unseen = on.distance - distance;
  }
};
