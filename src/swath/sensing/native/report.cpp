// What the electronics make of 16 distances: the body of a native function, after rays/single/vectors.cpp. Rules as in scanner.py.
//
// In: p, the packet; e and beams (see `Electronics` and `Beams`). Out, in e, nan = no echo: ranges, intensity (n,), points (n, 3)
// in the world, of the true distance.

const int count = beams.count;

const int start = p * N, room = beams.normal.shape[1];
const F r = load(beams.distance.data + start), albedo = load(beams.cosine.data + start) * load(beams.reflectance.data + start);
const I what = loadi(beams.kind.data + start);
I seen = (what > 0) & (what != e.blind) & (I)(r >= e.range_min);
const F signal = albedo / (r * r * e.least_energy.data[0]);  // received energy over the least detectable
seen &= ((what != e.judged) & (e.judged >= 0 ? -1 : 0)) | (I)(signal >= 1.0f);

auto line = [&](const float* row, int rows, F x) -> F {  // straight between the points of a table, held outside
  F y = put(row[1]);
  for (int i = 0; i + 1 < rows; ++i, row += 2) y += within((x - row[0]) / (row[2] - row[0]), 0.0f, 1.0f) * (row[3] - row[1]);
  return y;
};
F measured = r;
if (e.is_noisy) {
  F sigma = line(e.sigma.data, e.sigma.shape[0] / 2, r);
  if (e.by_signal.shape[0] > 0)
    sigma = most(sigma, exp_of(line(e.by_signal.data, e.by_signal.shape[0] / 2, log_of(most(signal, put(1.0e-9f)) * e.at_reach))));
  measured = r + e.bias + sigma * load(beams.normal.data + room + start);
  if (e.resolution > 0.0f) measured = __builtin_elementwise_rint(measured / e.resolution) * e.resolution;
}
const F nothing = put(__builtin_nanf(""));
store(e.ranges.data + start, pick(seen, measured, nothing));
store(e.intensity.data + start, pick(seen, albedo, nothing));
for (int l = 0; l < N && start + l < count; ++l) {
  const size_t n = 3 * (size_t)(start + l);
  const double *o = (const double*)beams.origins.data + n, *d = (const double*)beams.directions.data + n, far = seen[l] ? (double)r[l] : __builtin_nan("");
  for (int i = 0; i < 3; ++i) ((double*)e.points.data)[n + i] = o[i] + far * d[i];
}
