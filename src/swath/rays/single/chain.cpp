// The chain of `scores.cpp` and `score_profile.cpp`: in their middle. In: o, the middle beam's origin; ground under it [m].
const float over = (float)o[2] - ground - 0.5f * canopy.height;

if (lines < 1) __builtin_memcpy(beams.score.data, beams.normal.data, sizeof(float) * count);
for (int first = 0; first < count && lines > 0; first += N) {
  float sinks[N] = {};
  for (int l = 0; l < N && first + l < count; ++l) sinks[l] = -(float)beams.directions.data[first + l][2];
  const F far = within(over / most(load(sinks), put(1.0e-3f)), 0.5f, range_max), spot = canopy.exit + canopy.divergence * far;
  const F rho = exp_of(-far * load(apart.data + first) / (canopy.correlation[0] + canopy.correlation[1] * spot));
  const F fresh = root(1.0f - rho * rho) * load(beams.normal.data + first);
  float keep[N], add[N];
  store(keep, rho);
  store(add, fresh);
  for (int l = 0; l < N && first + l < count; ++l) {
    const int n = first + l;
    beams.score.data[n] = n < lines ? beams.normal.data[n] : keep[l] * beams.score.data[n - lines] + add[l];
  }
}
