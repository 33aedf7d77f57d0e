// Where the machine stands at the time of a scan, where its beams go from there, each from its own time, and which echoes are of
// the stubble beside the edge.
//
// x, u, heading are in the frame at rest, the edge is in the machine's (x, u): u toward the crop.
const D seconds = smaller((stamp - step.scan_t) / 1e9, 1.0), speed = step.speed;
const Frame at = moved(d, step, seconds);
step.scan_t = stamp;
step.x = at.x;
step.u = at.u;
step.heading = at.angle;
s.travel = __builtin_fabs(speed) * seconds;
D low = OUTSIDE_FAR, high = OUTSIDE_NEAR;
if (track.has_arc != 0.0) {
  const D c = ::cos(step.heading), sn = ::sin(step.heading), dx = track.x - step.x, du = track.u - step.u;
  s.edge_x = c * dx + sn * du;
  s.edge_u = c * du - sn * dx;
  s.edge_angle = track.angle - step.heading;
  s.edge_bend = track.bend;
} else {
  s.edge_x = d.reference;
  s.edge_u = d.centre;
  s.edge_angle = s.edge_bend = 0.0;
  low -= 0.5;
  high = -d.search;
}
const int answered = ranges.shape[2] == 0 ? 0 : ranges.shape[1];
const bool knows_dead = s.echo_beams == beam_count;
auto is_used = [&](const Beam& beam) {
  const D whole = beam.aim[0] + beam.aim[1] + beam.aim[2];
  return whole == whole && !(knows_dead && beam.is_dead != 0.0);
};
int used = 0;
for (int i = 0; i < beam_count; ++i) used += is_used(beams[i]);
for (int i = 0; used > s.room && i < m.beams.shape[0] * sizeof(D) / sizeof(Beam); ++i) beams[i].before = __builtin_nan("");
s.room = larger(s.room, used);
const D c = ::cos(s.edge_angle), sn = ::sin(s.edge_angle);
int n = 0, beside = 0;
for (int i = 0; i < beam_count; ++i) {
  const D *aim = beams[i].aim, t = beams[i].ago;
  if (!is_used(beams[i]) || !(aim[2] < STEEPEST)) continue;
  const D turn = d.sign * step.yaw_rate * t, ct = ::cos(turn), st = ::sin(turn);
  Ray& ray = rays[n];
  ray.start[0] = speed * t + ct * d.place[0] - st * d.place[1];
  ray.start[1] = d.sign * (0.5 * speed * t * turn + st * d.place[0] + ct * d.place[1]);
  ray.start[2] = d.place[2];
  ray.aim[0] = ct * aim[0] - st * aim[1];
  ray.aim[1] = d.sign * (st * aim[0] + ct * aim[1]);
  ray.aim[2] = aim[2];
  D r = i < answered ? (D)wp::index(ranges, w, i, 0) : __builtin_nan("");
  if (!(r > 0.0 && r < FAR)) r = __builtin_nan("");
  ray.distance = r;
  D& before = beams[n++].before;
  ray.stands = __builtin_fabs(r - before) < REPEATS * r;
  before = r;
  if (!(r > NEAR && ray.stands != 0.0)) continue;
  const D x = ray.start[0] + ray.aim[0] * r, u = ray.start[1] + ray.aim[1] * r, z = ray.start[2] + ray.aim[2] * r;
  const D dx = x - s.edge_x, du = u - s.edge_u, along = c * dx + sn * du;
  const D aside = c * du - sn * dx - 0.5 * s.edge_bend * along * along;
  if (!(aside > low && aside < high && z < GROUND_MOST && z > GROUND_LEAST)) continue;
  seen_x[beside] = x;
  seen_u[beside] = du;
  seen_z[beside++] = z;
}
s.falling = n;
s.beside = beside;
s.across = ::atan2(s.edge_u - d.sign * d.place[1], s.edge_x - d.place[0]) - s.edge_angle;
