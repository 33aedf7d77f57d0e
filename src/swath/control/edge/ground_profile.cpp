// The ground under the wheels and ahead; by how much it rises there between crop and stubble [1]: see ground_profile.py.
constexpr int COUNT = sizeof(SCALES) / sizeof(D);
const int cells = (int)d.cells, size = FIRST + 2 * cells;
D *means = m.mean.data, *both = m.covariance.data, *along = seen_z + beam_count, *across = along + size, *worth = across + size,
  *with_state = worth + size, *part = with_state + size;
auto way = [&](int cell, D begin, D end) __attribute__((noinline)) {  // metres of a cell between two places [m]; less than 0 where they are the other way
  const D low = smaller(begin, end), high = larger(begin, end), first = d.first + CELL * cell;
  const D inside = (high < first + CELL ? high : first + CELL) - (low > first ? low : first);
  return (inside > 0.0 ? inside : 0.0) * (end >= begin ? 1.0 : -1.0);
};
auto at = [&](int cell, D x) { return way(cell, x - 0.5 * CELL, x + 0.5 * CELL) / CELL; };  // its part in the slope at a place
auto advance = [&]() {  // one more cell ahead, and one less behind
  for (int ring = FIRST; ring < size; ring += cells) {
    const int last = ring + cells - 1;
    for (int k = 0; k < COUNT; ++k) {
      D *mean = means + k * size, *p = both + k * size * size;
      for (int i = ring; i < last; ++i) mean[i] = mean[i + 1];
      for (int i = ring; i < last; ++i)
        for (int j = 0; j < size; ++j) p[i * size + j] = p[(i + 1) * size + j];
      for (int i = 0; i < size; ++i)
        for (int j = ring; j < last; ++j) p[i * size + j] = p[i * size + j + 1];
      mean[last] = mean[last - 2] * NEXT[0] + mean[last - 1] * NEXT[1];
      for (int j = 0; j < size; ++j) part[j] = p[(last - 2) * size + j] * NEXT[0] + p[(last - 1) * size + j] * NEXT[1];
      const D own = part[last - 2] * NEXT[0] + part[last - 1] * NEXT[1];
      for (int j = 0; j < size; ++j) p[last * size + j] = p[j * size + last] = part[j];
      p[last * size + last] = own + SCALES[k] * SCALES[k] * NEW;
    }
  }
  for (int k = 0; k < COUNT; ++k) {
    for (int i = 0; i < FIRST; ++i) both[k * size * size + i * (size + 1)] += square(CHANGES);
    s.worth[k] *= KEEPS;  // what is long ago says little of how uneven the ground is here
  }
};
auto measure = [&](D value, D sd) __attribute__((noinline)) {  // the product of the state with `worth` was measured
  for (int k = 0; k < COUNT; ++k) {
    D *mean = means + k * size, *p = both + k * size * size;
    auto product = [&](const D* of) {
      for (int j = 0; j < size; ++j) part[j] = of[j] * worth[j];
      return sum(part, size);
    };
    for (int i = 0; i < size; ++i) with_state[i] = product(p + i * size);
    const D variance = product(with_state) + square(sd), away = value - product(mean);
    for (int i = 0; i < size; ++i) {
      const D gain = with_state[i] / variance;
      mean[i] += gain * away;
      for (int j = 0; j < size; ++j) p[i * size + j] -= gain * with_state[j];
    }
    s.worth[k] -= 0.5 * (away * away / variance + ::log(variance));
  }
  D most = s.worth[0];
  for (int k = 1; k < COUNT; ++k) most = larger(most, s.worth[k]);
  for (int k = 0; k < COUNT; ++k) s.worth[k] -= most;
};
auto clear_worth = [&](int first, D one) {
  for (int j = 0; j < size; ++j) worth[j] = 0.0;
  worth[first] = one;
};
auto learn = [&](const D* seen, const D* felt) {
  // Means over the last cell. The parabola across that has the seen slope there meets the way of the wheels as high as the plane
  // is half as far aside. What the unit felt is taken off it: there the roughness below the wheels is none.
  const D axle = -0.5 * CELL;
  for (int c = 0; c < cells; ++c) {
    along[c] = way(c, axle - d.base, axle) / d.base;
    across[c] = at(c, axle);
  }
  for (int side = 0; felt && side < 2; ++side) {
    clear_worth(MEANS[side], 1.0);
    for (int c = 0; c < cells; ++c) worth[FIRST + side * cells + c] = side ? across[c] : along[c];
    measure(felt[side], FELT_SD);
  }
  if (!seen) return;
  const D x = seen[0], aside = 0.5 * seen[1], level = seen[2] - aside * seen[3];
  clear_worth(STUBBLE, 1.0);
  for (int c = 0; c < cells; ++c) {
    worth[FIRST + c] = way(c, axle, axle + x);
    worth[FIRST + cells + c] = aside * at(c, axle + x);
    if (felt) continue;
    worth[FIRST + c] -= x * along[c];
    worth[FIRST + cells + c] -= aside * across[c];
  }
  if (felt) {
    worth[MEANS[0]] = x;
    worth[MEANS[1]] = aside;
    measure(level + x * felt[0] + aside * felt[1], SEEN_SD);
  } else {
    const D both_sd[2] = {SEEN_SD, x * FELT_SD};
    measure(level, exact_length(both_sd, 2));
  }
};

// what was seen and felt over the travel to this scan
const bool is_seen = s.is_seen != 0.0;
s.grade = 0.0;
if (is_seen || s.is_known != 0.0) {
  s.cell_travel += s.travel;
  const D weight = larger(s.travel, STANDS), beside = s.middle_u;
  const D now[5] = {s.middle_x, s.edge_u + beside, s.level + s.slope * beside, s.slope, 1.0};
  const D rise[3] = {step.ahead, d.sign * step.rise, 1.0};
  for (int i = 0; is_seen && i < 5; ++i) s.seen[i] += weight * now[i];
  for (int i = 0; step.is_sure != 0.0 && i < 3; ++i) s.felt[i] += weight * rise[i];
}
if (s.cell_travel >= CELL) {
  for (int i = 0; i < 4; ++i) s.seen[i] /= s.seen[4];
  for (int i = 0; i < 2; ++i) s.felt[i] /= s.felt[2];
  s.cell_travel -= CELL;
  advance();
  learn(s.seen[4] > 0.0 ? s.seen : nullptr, s.felt[2] > 0.0 ? s.felt : nullptr);
  for (int i = 0; i < 5; ++i) s.seen[i] = 0.0;
  for (int i = 0; i < 3; ++i) s.felt[i] = 0.0;
  D chance[COUNT], sums[3] = {};
  for (int k = 0; k < COUNT; ++k) sums[0] += chance[k] = ::exp(s.worth[k]);
  for (int k = 0; k < COUNT; ++k) sums[1] += (s.chance[k] = chance[k] / sums[0]) * means[k * size + STUBBLE];
  for (int k = 0; k < COUNT; ++k) {
    const D away = means[k * size + STUBBLE] - sums[1];
    sums[2] += s.chance[k] * (away * away + both[k * size * size + STUBBLE * (size + 1)]);
  }
  row.ground.plane = sums[1];
  row.ground.plane_sd = __builtin_sqrt(sums[2]);
}
if (is_seen) {  // slope between two places ahead, over the plane of the wheels
  const D end = s.middle_x, begin = smaller(end - d.flat * track.height, end - CELL);
  for (int c = 0; c < cells; ++c) {
    const D share = way(c, begin, end) / (end - begin) - way(c, -d.base, 0.0) / d.base;
    D mean = 0.0;
    for (int k = 0; k < COUNT; ++k) mean += s.chance[k] * means[k * size + FIRST + c];
    part[c] = share * mean;
  }
  s.grade = sum(part, cells);
}
