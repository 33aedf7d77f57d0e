// How far the feet stand behind the canopy's edge, as canopy_offset.py says; o: `canopy_offset_kernel.Offset`. After numbers.cpp.
static constexpr D REACHED = 0.9;                       // share of the rays within the stand that are stopped above the height watched
static constexpr D INSIDE_FROM = 0.4, INSIDE_TO = 1.5;  // m behind the step: the stand within
static constexpr D FEWEST = 60.0;                       // echoes within, before their heights count
static constexpr D STRAY = 0.02;                        // share of rays on the wrong side whatever the edge
static constexpr D COUNT = 1.0 / 4.0;                   // scans see the same stems: independent samples per ray
static constexpr D GUESS_SD = 0.05;                     // m, of the shift about the guess

// Height [m] below which a share of a histogram lies: counts in n layers from 0 up, their sum.
static constexpr auto height_at = [](const D* heights, int n, D total, D share, D layer) __attribute__((noinline)) {
  D reached = heights[0], after = reached / total;
  if (share < after) return layer;
  for (int i = 1; i < n; ++i) {
    const D before = after;
    reached += heights[i];
    after = reached / total;
    if (share < after) return (layer * (i + 1) - layer * i) / (after - before) * (share - before) + layer * i;
  }
  return layer * n;
};
static constexpr auto stopped_depth = [](const auto& o, D most) {  // pieces that a ray meets where a share of them is stopped
  const D *met = o.met.data, *chance = o.chance.data;
  int low = 0, high = o.chance.shape[0] - 1;
  if (most < chance[0]) return met[0];
  if (most >= chance[high]) return met[high];
  while (high - low > 1) {
    const int k = (low + high) / 2;
    (chance[k] <= most ? low : high) = k;
  }
  return (met[high] - met[low]) / (chance[high] - chance[low]) * (most - chance[low]) + met[low];
};
// Mean shift under the likelihood of the counts and the guess [m]; passed, held: rays that went on and that were stopped, by place.
static constexpr auto fitted_shift = [](const auto& o, D guess, const D* passed, const D* held, D* scratch) __attribute__((noinline)) {
  const int places = o.middle.shape[0], shifts = o.shifts.shape[0], shares = o.there.shape[0], steps = o.share.shape[0];
  const int last = o.met.shape[0] - 1;
  const D *met = o.met.data, *chance = o.chance.data, step = met[1] - met[0];
  D all_passed = 0.0, all_held = 0.0;
  for (int i = 0; i < places; ++i) {
    if (!(o.middle.data[i] > INSIDE_FROM)) continue;
    all_passed += passed[i];
    all_held += held[i];
  }
  const D depth = stopped_depth(o, smaller(larger(all_held / larger(all_passed + all_held, 1e-9), 0.3), 1.0 - STRAY));
  D *stops = scratch, *goes = stops + shares, *logs = goes + shares;  // logarithms of chances, by share, and as they are looked up
  for (int i = 0; i < shares; ++i) {
    const D x = depth * o.there.data[i];
    D stopped = chance[last];
    if (x < met[last]) {
      int k = (int)(x / step);
      k = k < 0 ? 0 : k > last - 1 ? last - 1 : k;
      if (met[k] > x) --k;
      if (met[k + 1] <= x) ++k;
      stopped = (chance[k + 1] - chance[k]) / (met[k + 1] - met[k]) * (x - met[k]) + chance[k];
    }
    const D high = STRAY + (1.0 - STRAY) * stopped;
    goes[i] = ::log(1.0 - high);
    stops[i] = ::log(high);
  }
  for (int i = 0; i < steps; ++i)
    for (int spread = 0; spread < SPREADS; ++spread) {
      const int share = o.share.data[SPREADS * i + spread];
      logs[2 * SPREADS * i + spread] = stops[share];
      logs[2 * SPREADS * i + SPREADS + spread] = goes[share];
    }
  D *score = logs + 2 * SPREADS * steps, *chances = stops, best = -INFINITE;  // (spreads, shifts): log-likelihood [nat]
  for (int shift = 0; shift < shifts; ++shift) {
    D total[SPREADS] = {};
    for (int place = 0; place < places; ++place) {
      const D* row = logs + 2 * SPREADS * o.step.data[places * shift + place];
      for (int spread = 0; spread < SPREADS; ++spread) total[spread] += held[place] * row[spread] + passed[place] * row[SPREADS + spread];
    }
    const D away = (o.shifts.data[shift] - guess) / GUESS_SD;
    for (int spread = 0; spread < SPREADS; ++spread) {
      score[shifts * spread + shift] = total[spread] - 0.5 * (away * away);
      best = larger(best, score[shifts * spread + shift]);
    }
  }
  for (int i = 0; i < SPREADS * shifts; ++i) {
    chances[i] = ::exp(score[i] - best);
    score[i] = chances[i] * o.shifts.data[i % shifts];
  }
  return sum(score, SPREADS * shifts) / sum(chances, SPREADS * shifts);
};
