// The strongest echo of the air on beams: the body of a native function (dust_kernel.py).
//
// In: `whole`: addresses of optical depths and extinctions (beams, steps), of the steps found and their extinction exp(-2 depth) / range^2
// (beams); beams, steps. `real`: step, nearest range [m].

typedef double D;
typedef long long L;
const D *depths = (const D*)whole.data[0], *local = (const D*)whole.data[1], step = real.data[0], nearest = real.data[1];
L *best = (L*)whole.data[2], beams = whole.data[4], steps = whole.data[5];
D* energy = (D*)whole.data[3];
for (L b = 0; b < beams; ++b, depths += steps, local += steps) {
  D most = 0.0, left = 1.0;  // of light there and back
  best[b] = 0;
  for (L n = 0; n < steps; ++n) {
    const D way = step * (n + 0.5), here = local[n] / (way * way);
    if (way < nearest || here * left <= most) continue;  // further on there is no more left
    left = ::exp(-2.0 * (depths[n] - 0.5 * step * local[n]));
    if (here * left <= most) continue;
    most = here * left;
    best[b] = n;
  }
  energy[b] = most;
}
