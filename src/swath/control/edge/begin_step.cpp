// What comes with a step, into its row: the body of a native function, after numbers.cpp.
//
// In: unit, a memory of `Inclination`; time and length of the step [ns], speed over ground [m/s], yaw rate to the left [rad/s], share
// of the header's width that cuts, nan = not known.
Row& q = *(Row*)row.data;
const auto& d = q.detector;
auto& s = q.step;
const D *up = (D*)unit.data + UP, steep = larger(up[2], 0.5);
s.now = now;
s.speed = speed;
s.yaw_rate = d.sign * (__builtin_isfinite(rate) ? rate : 0.0);
s.ahead = up[0] / steep;  // of the foot of an upright plant its top seems to stand so far ahead, and to the left, per height
s.rise = up[1] / steep;
s.is_sure = unit.data[SINCE] >= SURE_S;
s.missing = d.width * (1.0 - fill);
s.travel = __builtin_fabs(speed) * dt / 1e9;
