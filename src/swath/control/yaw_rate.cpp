// A step of `YawRate` over samples: the body of a native function, after exact.cpp.
//
// In and out: m, see yaw_rate.py, whose offsets these are.

typedef double D;
D *m = (D*)memory.data, *angle = m + 9, *unit = m + 12;  // of each: means, and the seconds they are over
D &bias = m[14], &since = m[15];
constexpr D LONGEST_S = 0.5, AGAIN_S = 0.5;  // s: of a step that counts, from one estimate to the next
const D rate = m[1], speed = m[2], steer = m[3], seconds = m[4] < LONGEST_S ? m[4] : LONGEST_S, wheelbase = m[5];
const D *up = m + 6, *samples = m + 21;
const int rows = (int)m[0];
constexpr D DEG = 3.141592653589793 / 180.0;
// sensor: standard deviation when sound, when faulty; estimates after the data sheets of the bundled ones
constexpr D GYRO[2] = {0.03 * DEG, 0.5 * DEG}, UNIT[2] = {0.1 * DEG, 0.5 * DEG};  // rad/s: of odometry, inertial unit
constexpr D ANGLE = 0.2 * DEG, FAULTY_ANGLE = 10.0 * DEG;  // rad: of the steering angle's zero
constexpr D LEAST = 0.003 * DEG;  // rad/s: a machine at rest turns by no more, whatever its sensors say
constexpr D FAULTY = 0.05;  // chance of each sensor
constexpr D UNDERSTEER = 10.0 * 0.01;  // of the yaw rate that the wheels are at
constexpr D MEMORY_S = 20.0;  // s over which differences are averaged
auto is_finite = [](D x) { return x - x == 0.0; };
if (!is_finite(rate)) return;
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

// the bias: the mean over all combinations of sound and faulty sensors
since = since + seconds;
if (since < AGAIN_S) return;
since = 0.0;
const D chances[2] = {::log(1.0 - FAULTY), ::log(FAULTY)};
auto length_of = [&](D x, D y) {
  const D both[2] = {x, y};
  return exact_length(both, 2);
};
D precision[2][2], pull[2][2], cost[2][2];
int others = 0;
auto weigh = [&](D away, D sound, D faulty) {
  const D sds[2] = {sound, faulty};
  for (int k = 0; k < 2; ++k) {
    precision[others][k] = 1.0 / ::pow(sds[k], 2.0);
    pull[others][k] = away / ::pow(sds[k], 2.0);
    cost[others][k] = 2.0 * ::log(sds[k]) + ::pow(away / sds[k], 2.0);
  }
  ++others;
};
if (angle[2] > AGAIN_S) weigh(angle[0], length_of(angle[1], LEAST), length_of(angle[1] * FAULTY_ANGLE / ANGLE, LEAST));
if (unit[1] > AGAIN_S) weigh(unit[0], UNIT[0], UNIT[1]);
D logs[8], means[8], most = 0.0;
const int combinations = 2 << others;
for (int which = 0; which < combinations; ++which) {
  const int gyro = which >> others & 1;
  D p = 1.0 / ::pow(GYRO[gyro], 2.0), to = 0.0, c = 2.0 * ::log(GYRO[gyro]);
  ExactSum chance;
  chance.add(chances[gyro]);
  for (int k = 0; k < others; ++k) {
    const int is_faulty = which >> (others - 1 - k) & 1;
    p = p + precision[k][is_faulty];
    to = to + pull[k][is_faulty];
    c = c + cost[k][is_faulty];
    chance.add(chances[is_faulty]);
  }
  c = c + (::log(p) - ::pow(to, 2.0) / p);
  logs[which] = (chance.sum + chance.rest) - 0.5 * c;
  means[which] = to / p;
  most = which && most > logs[which] ? most : logs[which];
}
ExactSum weights, weighted;
for (int which = 0; which < combinations; ++which) {
  const D weight = ::exp(logs[which] - most);
  weights.add(weight);
  weighted.add(weight * means[which]);
}
bias = (weighted.sum + weighted.rest) / (weights.sum + weights.rest);
