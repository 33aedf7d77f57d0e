// A step of `Inclination` over samples: the body of a native function, after exact.cpp.
//
// In and out: m, see inclination.py, whose offsets these are.

typedef double D;
D *m = (D*)memory.data, *up = m + 2, *bias = m + 5, *known = m + 8, *last = m + 9, *speed_before = m + 10, *since = m + 20;
const D *turn = m + 11, *samples = m + 21, speed = m[1];
const int rows = (int)m[0];
constexpr D NS = 1e9, LEAST_S = 1e-6;  // s: samples of one moment
constexpr D SETTLE_S = 3.0, BIAS_S = 30.0;  // s: time constants of the pull of gravity, of the gyroscopes' bias
constexpr D LEAST_FORCE = 1.0;  // m/s2: a smaller specific force has no direction

ExactSum sums[6];
int count = 0;
D t = 0.0;
for (int n = 0; n < rows; ++n) {
  const D *s = samples + 7 * n, whole = s[1] + s[2] + s[3] + s[4] + s[5] + s[6];
  if (!(whole - whole == 0.0)) continue;
  for (int i = 0; i < 6; ++i) sums[i].add(s[1 + i]);
  t = s[0];
  ++count;
}
if (!count) return;
D mean[6], rate[3], force[3];
for (int i = 0; i < 6; ++i) mean[i] = (sums[i].sum + sums[i].rest) / count;
for (int i = 0; i < 3; ++i) {
  const D* r = turn + 3 * i;
  rate[i] = r[0] * mean[0] + r[1] * mean[1] + r[2] * mean[2];
  force[i] = r[0] * mean[3] + r[1] * mean[4] + r[2] * mean[5];
}
D seconds = (t - *last) / NS;
seconds = seconds > 0.0 ? seconds : 0.0;
seconds = seconds < 1.0 ? seconds : 1.0;
const bool was_known = *known != 0.0;
const D forward = was_known && seconds > 0.0 ? (speed - *speed_before) / seconds : 0.0;
const D p = rate[0] - bias[0], q = rate[1] - bias[1], r = rate[2] - bias[2];
D to[3] = {force[0] - forward, force[1] - speed * r, force[2] + speed * q};
const D size = exact_length(to, 3);
*last = t;
*speed_before = speed;
if (size < LEAST_FORCE) return;
for (int i = 0; i < 3; ++i) to[i] /= size;
if (!was_known) {
  for (int i = 0; i < 3; ++i) up[i] = to[i];
  *known = 1.0;
  return;
}
*since = *since + seconds;
D over = *since + seconds < SETTLE_S ? *since + seconds : SETTLE_S;
over = over > LEAST_S ? over : LEAST_S;
const D pull = seconds / over < 1.0 ? seconds / over : 1.0;
const D push = (seconds / SETTLE_S < 1.0 ? seconds / SETTLE_S : 1.0) / BIAS_S;
const D a = up[0], b = up[1], c = up[2];
D now[3] = {a - seconds * (q * c - r * b), b - seconds * (r * a - p * c), c - seconds * (p * b - q * a)};
bias[0] = bias[0] + push * (now[1] * to[2] - now[2] * to[1]);
bias[1] = bias[1] + push * (now[2] * to[0] - now[0] * to[2]);
bias[2] = bias[2] + push * (now[0] * to[1] - now[1] * to[0]);
for (int i = 0; i < 3; ++i) now[i] = now[i] + pull * (to[i] - now[i]);
const D whole = exact_length(now, 3);
for (int i = 0; i < 3; ++i) up[i] = now[i] / whole;
