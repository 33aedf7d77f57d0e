// A sample of the level `error`, from the motion to the noise: the body of a native function, after exact.cpp. The same
// operations in the same order as `Strapdown` and `ErrorImu` do them in Python.
//
// In and out: m, see `imu_step.py`, whose offsets these are. Out: the sample, six numbers.

typedef double D;
D* m = (D*)memory.data;
const D *count = m, *first = m + 1, *scale = m + 56, *steps = m + 68, *white = m + 74, *draw = m + 80;
const D *before = *count > 1.0 ? m + 14 : first, *newest = m + 27, *place = m + 40, *mounting = m + 43;
D *bias = m + 62, *velocity = m + 52, *reading = m + 92, *sample = (D*)told.data;
constexpr D NS = 1e9, GRAVITY = 9.81;

auto turned_back = [](const D* r, const D* v, D* out) {  // as `strapdown.back`
  for (int i = 0; i < 3; ++i) out[i] = r[i] * v[0] + r[3 + i] * v[1] + r[6 + i] * v[2];
};
auto point = [&](const D* state, D* out) {
  const D* r = state + 4;
  for (int i = 0; i < 3; ++i) out[i] = r[3 * i] * place[0] + r[3 * i + 1] * place[1] + r[3 * i + 2] * place[2] + state[1 + i];
};

// rate: `rotation_vector`
const D *a = first + 4, *j = newest + 4;
D turn[3] = {0.5 * (a[2] * j[1] + a[5] * j[4] + a[8] * j[7] - (a[1] * j[2] + a[4] * j[5] + a[7] * j[8])),
             0.5 * (a[0] * j[2] + a[3] * j[5] + a[6] * j[8] - (a[2] * j[0] + a[5] * j[3] + a[8] * j[6])),
             0.5 * (a[1] * j[0] + a[4] * j[3] + a[7] * j[6] - (a[0] * j[1] + a[3] * j[4] + a[6] * j[7]))};
const D trace = a[0] * j[0] + a[3] * j[3] + a[6] * j[6] + (a[1] * j[1] + a[4] * j[4] + a[7] * j[7]) +
                (a[2] * j[2] + a[5] * j[5] + a[8] * j[8]);
const D sine = exact_length(turn, 3), size = sine > 1e-12 ? ::atan2(sine, 0.5 * (trace - 1.0)) / sine : 1.0;
for (int i = 0; i < 3; ++i) turn[i] *= size;

// force
const D begin = first[0] / NS, span = (newest[0] - first[0]) / NS;
const D s0 = velocity[0], s1 = 0.5 * (before[0] + newest[0]) / NS, often = NS / (newest[0] - before[0]);
const D per_s = s1 > s0 ? 1.0 / (s1 - s0) : 0.0, way = (begin - 0.5 * (s0 + s1)) / span;
D from[3], to[3], now[3], change[3], at_first[3], about[3], force[3], rate[3];
point(before, from);
point(newest, to);
for (int i = 0; i < 3; ++i) now[i] = (to[i] - from[i]) * often;
for (int i = 0; i < 3; ++i) change[i] = (now[i] - velocity[1 + i]) * per_s;
change[2] += GRAVITY;
turned_back(a, change, at_first);
for (int i = 0; i < 3; ++i) about[i] = turn[i] * way;
{  // `turned`
  const D *v = at_first, p = about[0], q = about[1], r = about[2], angle = exact_length(about, 3);
  D by = 1.0, twice = 0.5;
  if (angle > 0.0) {
    by = ::sin(angle) / angle;
    const D half = ::sin(0.5 * angle) / angle;
    twice = 2.0 * (half * half);
  }
  const D cx = q * v[2] - r * v[1], cy = r * v[0] - p * v[2], cz = p * v[1] - q * v[0];
  force[0] = v[0] + by * cx + twice * (q * cz - r * cy);
  force[1] = v[1] + by * cy + twice * (r * cx - p * cz);
  force[2] = v[2] + by * cz + twice * (p * cy - q * cx);
}
for (int i = 0; i < 3; ++i) rate[i] = turn[i] / span;
turned_back(mounting, rate, reading);
turned_back(mounting, force, reading + 3);

// errors
for (int i = 0; i < 6; ++i) {
  bias[i] = bias[i] + steps[i] * draw[6 + i];
  sample[i] = reading[i] * scale[i] + bias[i] + white[i] * draw[i];
}
velocity[0] = s1;
for (int i = 0; i < 3; ++i) velocity[1 + i] = now[i];
for (int i = 0; i < 13; ++i) m[1 + i] = newest[i];
