// A step of `YawRate` over samples: the body of a native function, after exact.cpp.
//
// In and out: m, see yaw_rate.py, whose offsets these are.

typedef double D;
D *m = (D*)memory.data, *angle = m + 5, *unit = m + 8;  // of each: means, and the seconds they are over
const D rate = m[1], speed = m[2], steer = m[3], seconds = m[4], wheelbase = m[10];
const D *up = m + 11, *samples = m + 21;
const int rows = (int)m[0];
constexpr D ANGLE = 0.2 * (3.141592653589793 / 180.0);  // rad: standard deviation of the steering angle's zero, as yaw_rate.py
constexpr D UNDERSTEER = 10.0 * 0.01;  // of the yaw rate that the wheels are at
constexpr D MEMORY_S = 20.0;  // s over which differences are averaged
auto is_finite = [](D x) { return x - x == 0.0; };
auto take = [&](D* mean, int count, const D* values) {
  D& held = mean[count];
  held = held + seconds < MEMORY_S ? held + seconds : MEMORY_S;
  const D share = held > 0.0 ? seconds / held : 0.0;
  for (int i = 0; i < count; ++i) mean[i] = mean[i] + share * (values[i] - mean[i]);
};
if (is_finite(speed) && is_finite(steer)) {
  const D wheels = speed * ::tan(steer) / wheelbase, off[2] = {speed / wheelbase * ANGLE, UNDERSTEER * wheels};
  const D values[2] = {rate - wheels, exact_length(off, 2)};
  take(angle, 2, values);
}
ExactSum turns;
int count = 0;
for (int n = 0; n < rows; ++n) {
  const D* s = samples + 7 * n;
  ExactSum one;
  for (int i = 0; i < 3; ++i) one.add(up[i] * s[1 + i]);
  const D turn = one.sum + one.rest;
  if (!is_finite(turn)) continue;
  turns.add(turn);
  ++count;
}
if (count) {
  const D value = rate - (turns.sum + turns.rest) / count;
  take(unit, 1, &value);
}
