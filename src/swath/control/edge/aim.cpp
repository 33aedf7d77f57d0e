// The way of a scan, stage DRIVE: the place of a step moves by its seconds. Or whether the edge is asked for, and what: the body of
// a native function.
//
// In: a row of report_rows.py. Out: the place of its step; is_found and fresh of its feet; `asks`, as `near_line_kernel.near`
// takes them.

constexpr double OLD = 0.15, LATE = 0.4;  // s: age of the newest scan from which on an edge is less sure, and is none
Row& q = *(Row*)row.data;
auto& s = q.step;
const auto& d = q.detector;
const auto& b = q.block;
const double age = (s.now - s.scan_t) / 1e9, fresh = (LATE - age) / (LATE - OLD), seconds = stage == DRIVE ? s.seconds : age;
// along the heading, and aside by crab, the side slip of the fixed axle per side force in g
const double crab = d.crab * (s.rise + d.sign * s.speed * s.yaw_rate / GRAVITY);
const double course = s.heading + 0.5 * s.yaw_rate * seconds - d.sign * crab, travel = s.speed * seconds;
const double x = s.x + travel * ::cos(course), u = s.u + travel * ::sin(course), heading = s.heading + s.yaw_rate * seconds;
if (stage == DRIVE) s.x = x, s.u = u, s.heading = heading;
if (!(stage & FEET)) return false;
q.feet.fresh = fresh < 1.0 ? fresh : 1.0;
q.feet.is_found = b.is_begun > 0.0 && age <= LATE && b.points >= 2.0;
const double cosine = ::cos(heading), sine = ::sin(heading), dx = b.x - x, du = b.u - u;
asks.data[world] = {b.points, x, u, heading, cosine * dx + sine * du, cosine * du - sine * dx, b.angle - heading, b.distance, d.reference};
return q.feet.is_found > 0.0;
