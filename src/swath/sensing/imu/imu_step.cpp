// A sample of the level `error`, from the motion to the noise: the body of a native function, after exact.cpp. Equations:
// strapdown.py, error.py.
//
// In: head, stamps [ns], poses of a trail of states; world; share: engine speed over rated speed; dt [ns]. In and out: memory,
// an `error.UNIT`. Out: told, six numbers.

typedef double D;
struct Unit {
  D last[13], velocity[4], reading[6], bias[6], scale[6], walk[6], density[6], phases[3], arm, period;
  struct { D size, frequency, force[3], rate[3]; } lines[3];
  D place[3], mounting[9], draw[12];
};
Unit& u = *(Unit*)memory.data;
D* sample = (D*)told.data;
constexpr D NS = 1e9, GRAVITY = 9.81, PI = 3.141592653589793;
const D seconds = (D)dt / NS;

auto turned_back = [](const D* r, const D* v, D* out) {  // into the frame whose axes are the columns of a rotation
  for (int i = 0; i < 3; ++i) out[i] = r[i] * v[0] + r[3 + i] * v[1] + r[6 + i] * v[2];
};
auto take = [&](int k, D* state) {
  state[0] = (D)stamps.data[k];
  for (int i = 0; i < 12; ++i) state[1 + i] = index(poses, k, world, i);
};
auto point = [&](const D* state, D* out) {
  const D *r = state + 4, *p = u.place;
  for (int i = 0; i < 3; ++i) out[i] = r[3 * i] * p[0] + r[3 * i + 1] * p[1] + r[3 * i + 2] * p[2] + state[1 + i];
};
auto between = [&](const D* a, const D* b, D* out) {  // time [s] and velocity of the unit from one state to another
  D from[3], to[3];
  point(a, from);
  point(b, to);
  const D often = NS / (b[0] - a[0]);
  out[0] = 0.5 * (a[0] + b[0]) / NS;
  for (int i = 0; i < 3; ++i) out[1 + i] = (to[i] - from[i]) * often;
};

const int count = (int)head.data[1];
int next = 0;
while (next < count && (D)stamps.data[next] <= u.last[0]) ++next;
if (next < count && u.last[0] != u.last[0]) {  // it was put in just now
  take(next++, u.last);
  const D up[3] = {0.0, 0.0, GRAVITY};
  D own[3];
  turned_back(u.last + 4, up, own);
  for (int i = 0; i < 3; ++i) u.reading[i] = 0.0;
  turned_back(u.mounting, own, u.reading + 3);
}
if (next < count) {
  D newest[13], before[13], now[4];
  take(count - 1, newest);
  if (count - next > 1) take(count - 2, before);
  else for (int i = 0; i < 13; ++i) before[i] = u.last[i];
  if (u.velocity[0] != u.velocity[0]) {
    D second[13];
    take(next, second);
    between(u.last, second, u.velocity);
  }
  between(before, newest, now);

  // rate: axis times angle of the turn, less than half a turn
  const D *a = u.last + 4, *j = newest + 4;
  D turn[3] = {0.5 * (a[2] * j[1] + a[5] * j[4] + a[8] * j[7] - (a[1] * j[2] + a[4] * j[5] + a[7] * j[8])),
               0.5 * (a[0] * j[2] + a[3] * j[5] + a[6] * j[8] - (a[2] * j[0] + a[5] * j[3] + a[8] * j[6])),
               0.5 * (a[1] * j[0] + a[4] * j[3] + a[7] * j[6] - (a[0] * j[1] + a[3] * j[4] + a[6] * j[7]))};
  const D trace = a[0] * j[0] + a[3] * j[3] + a[6] * j[6] + (a[1] * j[1] + a[4] * j[4] + a[7] * j[7]) +
                  (a[2] * j[2] + a[5] * j[5] + a[8] * j[8]);
  const D sine = exact_length(turn, 3), size = sine > 1e-12 ? ::atan2(sine, 0.5 * (trace - 1.0)) / sine : 1.0;
  for (int i = 0; i < 3; ++i) turn[i] *= size;

  // force, turned back from half way between the velocities to the last state (Rodrigues)
  const D begin = u.last[0] / NS, span = (newest[0] - u.last[0]) / NS, s0 = u.velocity[0], s1 = now[0];
  const D per_s = s1 > s0 ? 1.0 / (s1 - s0) : 0.0, way = (begin - 0.5 * (s0 + s1)) / span;
  D change[3], v[3], about[3], force[3], rate[3];
  for (int i = 0; i < 3; ++i) change[i] = (now[1 + i] - u.velocity[1 + i]) * per_s;
  change[2] += GRAVITY;
  turned_back(a, change, v);
  for (int i = 0; i < 3; ++i) about[i] = turn[i] * way;
  const D p = about[0], q = about[1], r = about[2], angle = exact_length(about, 3);
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
  for (int i = 0; i < 3; ++i) rate[i] = turn[i] / span;
  turned_back(u.mounting, rate, u.reading);
  turned_back(u.mounting, force, u.reading + 3);
  for (int i = 0; i < 4; ++i) u.velocity[i] = now[i];
  for (int i = 0; i < 13; ++i) u.last[i] = newest[i];
}

// vibration: the mean of each line over the step; its phase runs on with the engine
D felt[6];
for (int i = 0; i < 6; ++i) felt[i] = u.reading[i];
if (u.arm > 0.0) {
  D rate[3] = {}, force[3] = {}, more[6];
  for (int k = 0; k < 3; ++k) {
    const auto& line = u.lines[k];
    const D turn = 2.0 * PI * line.frequency * share * seconds, begin = u.phases[k];
    u.phases[k] = ::fmod(begin + turn, 2.0 * PI);
    if (turn <= 0.0) continue;
    const D mean = line.size * (share * share) * __builtin_sqrt(2.0) * (::cos(begin) - ::cos(begin + turn)) / turn;
    const D about = mean / (2.0 * PI * line.frequency * share * u.arm);
    for (int i = 0; i < 3; ++i) force[i] += line.force[i] * mean;
    for (int i = 0; i < 3; ++i) rate[i] += line.rate[i] * about;
  }
  turned_back(u.mounting, rate, more);
  turned_back(u.mounting, force, more + 3);
  for (int i = 0; i < 6; ++i) felt[i] += more[i];
}

// errors
if (dt - u.period > 1.0 || u.period - dt > 1.0) u.period = dt;  // else as the steps of a rate differ
const D root = __builtin_sqrt(u.period / NS);
for (int i = 0; i < 6; ++i) {
  u.bias[i] = u.bias[i] + u.walk[i] * root * u.draw[6 + i];
  sample[i] = felt[i] * u.scale[i] + u.bias[i] + u.density[i] / root * u.draw[i];
}
