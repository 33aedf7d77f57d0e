// The stubble side as a plane across the line of travel: z = level + slope (u - u0) [m].
//
// Weighted least squares on the echoes beside the edge; those far from the plane, weeds and straw, hardly count. The plane before
// is the prior, so that dust and gaps leave it. middle: x and u - u0 of the echoes near it [m], where they are enough to be seen.
constexpr int FEW = 5, MANY = 20;  // echoes near the plane before; so many elsewhere show that it was wrong
constexpr D STEEP = 0.3;  // slope of the plane at most
constexpr D RELAX = 0.98;  // part of the plane that is kept from scan to scan where the stubble sends no echoes
constexpr D WORTH[2] = {6.0, 60.0}, FIRST_WORTH[2] = {2.0, 2.0};  // echoes, and their m2, that the plane before is worth
const int n = (int)s.beside;
const D *x = seen_x, *u = seen_u, *z = seen_z;
D *own_u = seen_z + beam_count, *own_z = own_u + beam_count, *part = own_z + beam_count, *order = part + beam_count;
auto weight_of = [](D away) {
  const D more = 1.0 + away * away;
  return more * more;
};
auto set = [&](D level, D slope) {
  s.level = level;
  s.slope = within(-STEEP, slope, STEEP);
  s.is_known = 1.0;
};
auto fit = [&]() __attribute__((noinline)) {
  int count = 0;
  for (int i = 0; i < n; ++i)
    if (__builtin_fabs(z[i] - s.level) < GROUND_REACH) {
      own_u[count] = u[i];
      own_z[count++] = z[i];
    }
  if (!count) return set(s.level, s.slope);
  const D middle = sum(own_u, count) / count;
  const bool is_first = s.is_known == 0.0;
  const D* worth = is_first ? FIRST_WORTH : WORTH;
  D level = s.level + s.slope * middle, slope = s.slope;
  for (int i = 0; i < count; ++i) {
    own_u[i] -= middle;
    order[i] = own_z[i];
  }
  if (is_first) level = Np::median(order, count);
  D before = level;
  for (int round = is_first ? 0 : 1; round < 3; ++round) {  // at first any slope, then the nearest plane
    const D spread = round == 0 ? GROUND_REACH : GROUND_SPREAD;
    D sums[5];
    for (int k = 0; k < 5; ++k) {
      for (int i = 0; i < count; ++i) {
        const D ui = own_u[i], zi = own_z[i], wi = 1.0 / weight_of((zi - level - slope * ui) / spread);
        part[i] = k == 0 ? wi : k == 1 ? wi * ui : k == 2 ? wi * ui * ui : k == 3 ? wi * zi : wi * ui * zi;
      }
      sums[k] = sum(part, count);
    }
    const D s0 = sums[0] + worth[0], s1 = sums[1], s2 = sums[2] + worth[1];
    const D b0 = sums[3] + worth[0] * before, b1 = sums[4] + worth[1] * s.slope, det = s0 * s2 - square(s1);
    level = (s2 * b0 - s1 * b1) / det;
    slope = (s0 * b1 - s1 * b0) / det;
    if (round) continue;
    for (int i = 0; i < count; ++i) order[i] = own_z[i] - slope * own_u[i];
    level = before = Np::percentile(order, count, 0.25);
  }
  set(level - slope * middle, slope);
};

// the plane through these echoes, the one before being known: two rounds about that
D level = s.level, slope = s.slope;
int close = 0;
for (int round = 0; round < 2; ++round) {
  close = 0;
  D s0 = WORTH[0], s1 = 0.0, s2 = WORTH[1], b0 = WORTH[0] * s.level, b1 = WORTH[1] * s.slope;
  for (int i = 0; i < n; ++i) {
    if (!(__builtin_fabs(z[i] - s.level) < GROUND_REACH)) continue;
    const D ui = u[i], wi = 1.0 / weight_of((z[i] - level - slope * ui) / GROUND_SPREAD);
    s0 += wi;
    s1 += wi * ui;
    s2 += wi * ui * ui;
    b0 += wi * z[i];
    b1 += wi * ui * z[i];
    ++close;
  }
  const D det = s0 * s2 - s1 * s1;
  level = (s2 * b0 - s1 * b1) / det;
  slope = (s0 * b1 - s1 * b0) / det;
}
if (close < FEW && n >= MANY) {
  s.slope = s.is_known = 0.0;
  for (int i = 0; i < n; ++i) order[i] = z[i];
  s.level = Np::percentile(order, n, 0.25);
  fit();
} else if (close < FEW) {
  s.level *= RELAX;
  s.slope *= RELAX;
  if (close > 0 && s.is_known != 0.0) fit();
} else if (s.is_known != 0.0) {
  set(level, slope);
} else {
  fit();
}
int near = 0;
for (int i = 0; i < n; ++i)
  if (__builtin_fabs(z[i] - s.level - s.slope * u[i]) < GROUND_SPREAD) {
    own_u[near] = u[i];
    part[near++] = x[i];
  }
s.is_seen = s.is_known != 0.0 && near >= FEW;
s.middle_x = s.is_seen != 0.0 ? sum(part, near) / near : 0.0;
s.middle_u = s.is_seen != 0.0 ? sum(own_u, near) / near : 0.0;
