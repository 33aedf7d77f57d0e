// The height step of a profile.
//
// Heights are taken in lateral order from the edge as known so far, so that an error of heading does not smear it; the lateral slope
// of the stubble is the roll against the ground and is taken off. A ray says one thing: it was stopped in the upper half of the crop,
// or not. Where beside the edge it says so must not depend on which of both it was, or rays that cross the edge at an angle, in a bend,
// would show it elsewhere than rays along it: stopped only after a mean free path, or free in the shadow of the stand.

// u(x) = offset + slope (x - x0) + bend (x - x0)^2 / 2
struct Line {
  D x0, offset, slope, bend;
  bool is_there;
  D at(D x) const {
    const D ahead = x - x0;
    return offset + ahead * (slope + 0.5 * bend * ahead);
  }
};
// An edge point of a scan; count: of its rays
struct Step { bool is_there; int count; D x, u, variance, quality, crop, stubble, ground, separation, top, limit; };
// Lateral slope of n points on the stubble side, least squares shrunk toward 0 by 2 deg of roll.
static constexpr auto ground_slope = [](const D* lateral, const D* z, int n, D* values) __attribute__((noinline)) {
  const D middle = median(copy(z, n, values), n);
  D total = 0.0, across = 0.0, up = 0.0, noise = 0.0, both = 0.0, wide = 0.0;
  for (int i = 0; i < n; ++i) {
    const D away = (z[i] - middle) / 0.1, weight = values[i] = 1.0 / (1.0 + away * away);
    total += weight;
    across += weight * lateral[i];
    up += weight * z[i];
  }
  across = across / total;
  up = up / total;
  for (int i = 0; i < n; ++i) {
    const D dw = lateral[i] - across, dh = z[i] - up;
    noise += values[i] * dh * dh;
    both += values[i] * dw * dh;
    wide += values[i] * dw * dw;
  }
  return both / (wide + noise / total / (0.035 * 0.035) + TINY);
};
// Place x at which the edge point holds: midway between crop and stubble within 1 m of it.
static constexpr auto abreast = [](const D* x, const D* lateral, D edge, int first, int n, D* values) __attribute__((noinline)) {
  D total = 0.0;
  int sides = 0;
  for (int side = 0; side < 2; ++side) {
    int count = 0;
    for (int i = side ? first : 0; i < (side ? n : first); ++i)
      if (__builtin_fabs(lateral[i] - edge) < 1.0) values[count++] = x[i];
    if (count > 0) total += median(values, count), ++sides;
  }
  return sides > 0 ? total / sides : median(copy(x, n, values), n);
};
// The edge point of the echoes below a top. rise: of tops of plants toward the crop, nan = not known
static constexpr auto find_step = [](const auto& s, const Line& expected, int echoes, D highest, D rise, const D* sensor, D* const* row,
                                     int* index, int* wrong) __attribute__((noinline)) {
  Step step{};
  const D half = expected.is_there ? s.window : s.search;
  const Line line = expected.is_there ? expected : Line{0.0, s.centre, 0.0, 0.0, false};
  D *x = row[RAW_X], *z = row[RAW_LEVEL], *lateral = row[LATERAL], *values = row[VALUES], *met = row[MET], *level = row[LEVEL];
  int n = 0;
  for (int i = 0; i < echoes; ++i) {
    if (!(row[ECHO_Z][i] < highest)) continue;
    const D beside = row[ECHO_U][i] - line.at(row[ECHO_X][i]);
    if (__builtin_fabs(beside) < half) index[n] = i, met[n++] = beside;
  }
  if (n < 2 * MIN_POINTS) return step;
  const bool is_back = met[0] > met[n - 1];  // such scans come from the other side
  int* of = wrong;
  for (int i = 0; i < n; ++i) {
    const int k = is_back ? n - 1 - i : i;
    lateral[i] = met[k];
    of[i] = index[k];
  }
  sort_by(lateral, index, n);
  for (int i = 0; i < n; ++i) {
    x[i] = row[ECHO_X][of[index[i]]];
    z[i] = row[ECHO_Z][of[index[i]]];
  }
  Split split = split_by_otsu(z, n, values, wrong);
  if (!(split.gain > 0.0)) return step;
  int first = split.first;
  const D slope = ground_slope(lateral, z, first, values);
  for (int i = 0; i < n; ++i) z[i] = z[i] - slope * lateral[i];
  const D low = mean(z, first), limit = 0.5 * (low + mean(z + first, n - first));
  const D top = larger(smaller(share_of(copy(z + first, n - first, values), n - first, TOP), sensor[2] - 0.3), limit);
  const D aside = rise == rise ? rise : -slope;
  for (int i = 0; i < n; ++i) {
    const D down = larger(sensor[2] - z[i], 0.1), u = lateral[i] + line.at(x[i]);
    D share = smaller(larger((sensor[2] - top) / down, 0.0), 2.0);
    const D upper_x = sensor[0] + share * (x[i] - sensor[0]);
    const D upper = sensor[1] + share * (u - sensor[1]) - line.at(upper_x) - aside * (top - low);
    share = smaller(larger((sensor[2] - limit) / down, 0.0), 2.0);
    const D lower_x = sensor[0] + share * (x[i] - sensor[0]);
    const D lower = sensor[1] + share * (u - sensor[1]) - line.at(lower_x) - aside * (limit - low);
    share = upper > lower ? 1.0 - INNER : INNER;
    x[i] = share * upper_x + (1.0 - share) * lower_x;
    lateral[i] = share * upper + (1.0 - share) * lower;
    row[RAW_UPPER][i] = upper;
    row[RAW_LOWER][i] = lower;
  }
  sort_by(lateral, index, n);
  for (int i = 0; i < n; ++i) {
    const int k = index[i];
    row[AHEAD][i] = x[k];
    level[i] = z[k];
    row[UPPER][i] = row[RAW_UPPER][k];
    row[LOWER][i] = row[RAW_LOWER][k];
    met[i] = z[k] < limit ? smaller(z[k], low) : z[k];
  }
  split = split_by_otsu(met, n, values, wrong);
  if (!(split.gain > s.min_gain)) return step;
  first = split.first;
  const int rest = n - first;
  const D below = mean(level, first), above = mean(level + first, rest);
  const D spread = variance_of(level, first, below) + variance_of(level + first, rest, above);
  const D separation = (above - below) / __builtin_sqrt(spread + SMALL);
  if (above - below < s.min_step || separation < s.min_separation || __builtin_fabs(below) > MAX_GROUND) return step;
  const int fewest = wrong[first - 1];
  D sure = 0.0, middle = 0.0, variance = 0.0;
  for (int i = 0; i < n - 1; ++i) {
    const D gap = lateral[i + 1] - lateral[i], likely = wrong[i] < 0 ? 0.0 : ::exp(-ERROR_ODDS * (wrong[i] - fewest));
    values[i] = likely * smaller(larger(gap, 1e-3), 0.3);
    sure += values[i];
    middle += values[i] * (0.5 * (lateral[i + 1] + lateral[i]));
  }
  middle = middle / sure;
  for (int i = 0; i < n - 1; ++i) {
    const D gap = lateral[i + 1] - lateral[i], off = 0.5 * (lateral[i + 1] + lateral[i]) - middle;
    variance += values[i] / sure * (off * off + gap * gap / 12.0);
  }
  step.x = abreast(row[AHEAD], lateral, middle, first, n, values);
  step.u = line.at(step.x) + middle;
  step.variance = variance + RESOLUTION * RESOLUTION;
  step.quality = smaller(larger((separation - 0.5 * s.min_separation) / s.min_separation, 0.2), 1.0);
  step.ground = share_of(copy(level, first, values), first, 0.1);
  step.stubble = share_of(values, first, TOP) - step.ground;
  step.crop = share_of(copy(level + first, rest, values), rest, TOP) - step.ground;
  step.separation = separation;
  step.top = top - step.ground;
  step.limit = limit - step.ground;
  step.count = n;
  step.is_there = true;
  return step;
};
