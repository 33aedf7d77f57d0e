// `yaw_rate._bias` of what the numbers of a `YawRate` differ by: the body of a native function, after exact.cpp. The same
// operations in the same order as in Python.
//
// In: m, see yaw_rate.py, whose offsets these are.

typedef double D;
const D *m = (const D*)memory.data;
constexpr D DEG = 3.141592653589793 / 180.0, AGAIN_S = 0.5, FAULTY = 0.05, ANGLE = 0.2 * DEG, FAULTY_ANGLE = 10.0 * DEG, LEAST = 0.003 * DEG;
constexpr D GYRO[2] = {0.03 * DEG, 0.5 * DEG}, UNIT[2] = {0.1 * DEG, 0.5 * DEG};
const D chances[2] = {::log(1.0 - FAULTY), ::log(FAULTY)};
auto length_of = [&](D x, D y) {
  const D both[2] = {x, y};
  return exact_length(both, 2);
};
D precision[2][2], pull[2][2], cost[2][2];
int others = 0;
auto take = [&](D away, D sound, D faulty) {
  const D sds[2] = {sound, faulty};
  for (int k = 0; k < 2; ++k) {
    precision[others][k] = 1.0 / ::pow(sds[k], 2.0);
    pull[others][k] = away / ::pow(sds[k], 2.0);
    cost[others][k] = 2.0 * ::log(sds[k]) + ::pow(away / sds[k], 2.0);
  }
  ++others;
};
if (m[7] > AGAIN_S) take(m[5], length_of(m[6], LEAST), length_of(m[6] * FAULTY_ANGLE / ANGLE, LEAST));
if (m[9] > AGAIN_S) take(m[8], UNIT[0], UNIT[1]);
D logs[8], means[8], most = 0.0;
const int count = 2 << others;
for (int which = 0; which < count; ++which) {
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
for (int which = 0; which < count; ++which) {
  const D weight = ::exp(logs[which] - most);
  weights.add(weight);
  weighted.add(weight * means[which]);
}
return (weighted.sum + weighted.rest) / (weights.sum + weights.rest);
