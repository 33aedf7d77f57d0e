// The edge beside the machine: a robust local parabola through the blocks around the place that is reported.
//
// Interpolation, not extrapolation: the place lies just ahead of the knife, so that blocks stand on both sides. It is the
// track's, abreast of the reference; about it goes a parabola by weighted least squares with Tukey's biweight.
//
// Before the body of a native function, after overhang.cpp. In: a row of detector_rows.py; points: (x, u, variance, distance) in
// the frame at rest.

// m to both sides, over which the track's angle is taken; standard deviation of the weight along the edge, at least so many
// times the distance to the nearest point
constexpr D LOOK = 1.5, REACH = 2.5, NEAREST = 1.5;
// m2, of the variance of a point, and ridge of the offset; m, of the spread; share of the greatest weight from which on a point
// is near; share of the weights of those below which all count; of the slope
constexpr D FLOOR = 1e-4, LEAST_SPREAD = 0.02, NEAR_SHARE = 0.05, FEWEST = 0.2, SLOPE_PRIOR = 1.0 / (0.5 * 0.5);
// 1/m: prior standard deviation of the bend of any edge, and of one that nothing shows to be bent; deviations from which on it
// is one
constexpr D BENT_SD = 0.05, STRAIGHT_SD = 0.0015, PROVEN = 3.0;
struct Parabola {  // offset, slope, bend and their variances; spread of the points about it [m]
  wp::vec_t<3, D> p;
  D variance[3], spread;
};

auto fit = [&](int n, const D* at, const D* beside, const D* weight, D bend_sd) {
  D robust[ROOM], away[ROOM], most = 0.0;
  for (int i = 0; i < n; ++i) robust[i] = 1.0, most = larger(most, weight[i]);
  Parabola line;
  wp::mat_t<3, 3, D> inverse;
  auto residual = [&](int i) { return beside[i] - (line.p[0] + line.p[1] * at[i] + line.p[2] * 0.5 * at[i] * at[i]); };
  for (int round = 0; round < 3; ++round) {
    wp::mat_t<3, 3, D> a(FLOOR, 0.0, 0.0, 0.0, SLOPE_PRIOR, 0.0, 0.0, 0.0, 1.0 / (bend_sd * bend_sd));
    wp::vec_t<3, D> b;
    for (int i = 0; i < n; ++i) {
      const wp::vec_t<3, D> v(1.0, at[i], 0.5 * at[i] * at[i]), weighted = wp::mul(v, weight[i] * robust[i]);
      a = wp::add(a, wp::outer(weighted, v));
      b = wp::add(b, wp::mul(weighted, beside[i]));
    }
    inverse = wp::inverse(a);
    line.p = wp::mul(inverse, b);
    int count = 0;
    for (int i = 0; i < n; ++i) {
      if (!(weight[i] > NEAR_SHARE * most)) continue;
      const D value = __builtin_fabs(residual(i));
      int j = count++;
      for (; j > 0 && away[j - 1] > value; --j) away[j] = away[j - 1];
      away[j] = value;
    }
    const D median = count == 0 ? 0.0 : count % 2 ? away[count / 2] : 0.5 * (away[count / 2 - 1] + away[count / 2]);
    line.spread = MAD * median;
    D kept = 0.0, whole = 0.0;
    for (int i = 0; i < n; ++i) {
      const D r = residual(i) / (TUKEY * larger(line.spread, LEAST_SPREAD)), t = larger(1.0 - r * r, 0.0);
      robust[i] = t * t;
      if (weight[i] > NEAR_SHARE * most) kept += weight[i] * robust[i], whole += weight[i];
    }
    if (kept < FEWEST * whole)
      for (int i = 0; i < n; ++i) robust[i] = 1.0;
  }
  D squares = 0.0, total = 0.0;
  for (int i = 0; i < n; ++i) {
    const D r = residual(i), k = weight[i] * robust[i];
    squares += k * weight[i] * r * r, total += k;
  }
  for (int k = 0; k < 3; ++k) line.variance[k] = inverse.data[k][k] * larger(1.0, squares / larger(total, 1e-9));
  return line;
};

// here: where the machine stands; front: the track's newest place, seen from there
auto fit_near = [&](const Frame& here, const Frame& front) {
  const int n = (int)b.points;
  const D c = ::cos(here.angle), sn = ::sin(here.angle);
  D way[ROOM + 1], x[ROOM + 1], u[ROOM + 1];  // by their distance; x never falls
  for (int i = 0; i <= n; ++i) {
    D place[3] = {b.distance, front.x, front.u};
    if (i < n) {
      const D dx = points.data[i][0] - here.x, du = points.data[i][1] - here.u;
      place[0] = points.data[i][3], place[1] = c * dx + sn * du, place[2] = c * du - sn * dx;
    }
    int j = i;
    for (; j > 0 && way[j - 1] > place[0]; --j) way[j] = way[j - 1], x[j] = x[j - 1], u[j] = u[j - 1];
    way[j] = place[0], x[j] = place[1], u[j] = place[2];
  }
  for (int i = 1; i <= n; ++i) x[i] = larger(x[i], x[i - 1]);
  auto between = [&](const D* v, D at) {  // linear between neighbours, held outside
    int j = n;
    while (j >= 0 && !(x[j] <= at)) --j;
    return j < 0 ? v[0] : j == n ? v[n] : v[j] + (v[j + 1] - v[j]) * ((at - x[j]) / (x[j + 1] - x[j]));
  };
  D angle = front.angle, distance = way[0] - (x[0] - d.reference), gap = 1e300, seen_to = -1e300;
  if (d.reference >= x[0]) {
    angle = ::atan2(between(u, d.reference + LOOK) - between(u, d.reference - LOOK), LOOK + LOOK);
    distance = between(way, d.reference);
  }
  const D place_u = between(u, d.reference), ca = ::cos(angle), sa = ::sin(angle);
  for (int i = 0; i < n; ++i) {
    gap = smaller(gap, __builtin_fabs(points.data[i][3] - distance));
    seen_to = larger(seen_to, points.data[i][3] - distance);
  }
  const D reach = larger(REACH, NEAREST * gap);
  D at[ROOM], beside[ROOM], weight[ROOM];
  for (int i = 0; i < n; ++i) {
    const D dx = points.data[i][0] - here.x, du = points.data[i][1] - here.u, away = (points.data[i][3] - distance) / reach;
    const D ahead = c * dx + sn * du - d.reference, aside = c * du - sn * dx - place_u;
    at[i] = ca * ahead + sa * aside, beside[i] = ca * aside - sa * ahead;
    weight[i] = ::exp(-0.5 * away * away) / (points.data[i][2] + FLOOR);
  }
  Parabola line = fit(n, at, beside, weight, BENT_SD);
  const D bend_sd = __builtin_sqrt(line.variance[2]), bend = __builtin_fabs(line.p[2]);
  if (bend < PROVEN * bend_sd) line = fit(n, at, beside, weight, larger(STRAIGHT_SD, smaller(bend, 0.5 * bend_sd)));
  const D slope = line.p[1], steep = __builtin_sqrt(1.0 + slope * slope);
  q.line = {d.reference - line.p[0] * sa, place_u + line.p[0] * ca, angle + ::atan(slope), line.p[2] / (steep * steep * steep),
            __builtin_sqrt(line.variance[0]), __builtin_sqrt(line.variance[1]), gap, line.spread, seen_to};
};
