// Extinction by puffs of dust along beams: the body of a native function (dust_kernel.py).
//
// Eight steps of eight beams at a time, which is what a processor does at once, are 64 points in a box; a puff that has nothing in the
// nearest corner of the box is left out.
//
// In: `whole`: addresses of origins (beams, 3), directions (beams, 3), puffs (count, 7): as `packed` has them, and the exponent from
// which on they are nothing; reaches (beams), optical depths and extinctions (beams, steps); beams, steps, count. `real`: uniform
// extinction [1/m], height of the ground, below which all is as on it, step [m].

typedef double D;
typedef float F;
typedef long long L;
const D *origins = (const D*)whole.data[0], *ways = (const D*)whole.data[1], *puffs = (const D*)whole.data[2];
const D *reach = (const D*)whole.data[3], uniform = real.data[0], ground = real.data[1], step = real.data[2];
D *depths = (D*)whole.data[4], *local = (D*)whole.data[5];
const L beams = whole.data[6], steps = whole.data[7], count = whole.data[8];
constexpr int BEAMS = 8, POINTS = 64;

// exp of what is not above 0, to 2e-7: 2^n (1 + r + ... + r^6 / 6!), in operations that are alike on all processors.
auto falling = [](F v) -> F {
  v = v < -80.0f ? -80.0f : v;
  const F n = v * 1.44269504f + 12582912.0f, r = v - (n - 12582912.0f) * 0.693147181f, q = r * r;
  const F p = 1.0f + r + q * (0.5f + r * (1.0f / 6) + q * (1.0f / 24 + r * (1.0f / 120) + q * (1.0f / 720)));
  return p * __builtin_bit_cast(F, (__builtin_bit_cast(int, n) << 23) + 1065353216);
};

for (L begin = 0; begin < beams; begin += BEAMS) {
  const D x0 = origins[3 * begin], y0 = origins[3 * begin + 1];  // places are taken from here, so that they are short
  D depth[BEAMS] = {};
  for (L first = 0; first < steps; first += POINTS / BEAMS) {
    F x[POINTS], y[POINTS], z[POINTS], sum[POINTS] = {}, low[3] = {1e30f, 1e30f, 1e30f}, top[3] = {-1e30f, -1e30f, -1e30f};
    bool is_seen = false;
    for (int i = 0; i < POINTS; ++i) {
      const L b = begin + i % BEAMS < beams ? begin + i % BEAMS : beams - 1, n = first + i / BEAMS;
      const D *from = origins + 3 * b, *way = ways + 3 * b, s = step * (n + 0.5);
      x[i] = from[0] + s * way[0] - x0;
      y[i] = from[1] + s * way[1] - y0;
      z[i] = from[2] + s * way[2] - ground;
      z[i] = z[i] > 0.0f ? z[i] : 0.0f;
      if (step * n >= reach[b]) continue;
      is_seen = true;
      const F p[] = {x[i], y[i], z[i]};
      for (int a = 0; a < 3; ++a) {
        low[a] = p[a] < low[a] ? p[a] : low[a];
        top[a] = p[a] > top[a] ? p[a] : top[a];
      }
    }
    for (const D* puff = puffs; is_seen && puff < puffs + 7 * count; puff += 7) {
      const F px = puff[0] - x0, py = puff[1] - y0, high = puff[2], flat = -puff[3], steep = -puff[4], middle = puff[5];
      const F p[] = {px, py, high}, mirror = 4.0f * steep * high;  // the exponent of the image in the ground has so much z more
      F away[3];
      for (int a = 0; a < 3; ++a) away[a] = p[a] < low[a] ? low[a] - p[a] : p[a] > top[a] ? p[a] - top[a] : 0.0f;
      if (-(away[0] * away[0] + away[1] * away[1]) * flat - away[2] * away[2] * steep > (F)puff[6]) continue;
#pragma clang loop vectorize(enable)
      for (int i = 0; i < POINTS; ++i) {
        const F dx = x[i] - px, dy = y[i] - py, up = z[i] - high;
        sum[i] += middle * falling((dx * dx + dy * dy) * flat + up * up * steep) * (1.0f + falling(mirror * z[i]));
      }
    }
    for (int i = 0; i < POINTS; ++i) {
      const L b = begin + i % BEAMS, n = first + i / BEAMS;
      if (b >= beams || n >= steps) continue;
      const D here = step * n < reach[b] ? uniform + sum[i] : 0.0;
      local[b * steps + n] = here;
      depths[b * steps + n] = depth[i % BEAMS] += step * here;
    }
  }
}
