// Class and place of every ray, see canopy_rays.py, and what they add to the block of their scan. Given back: whether that has no
// room for one more scan.
const D limit = LIMIT * track.height, c = ::cos(s.edge_angle), sn = ::sin(s.edge_angle);
const D rise = d.sign * step.rise, plane_x = s.is_seen != 0.0 ? s.middle_x : 0.0;
auto clamped = [](D x, D low, D high) { return x > low ? (x < high ? x : high) : low; };  // nan is the least
struct Place { D along, beside; };
auto place = [&](D x, D u) {  // beside the arc [m]; second order in the way along
  const D dx = x - s.edge_x, du = u - s.edge_u, along = c * dx + sn * du;
  return Place{along, c * du - sn * dx - 0.5 * s.edge_bend * along * along};
};
auto above = [&](D x, D u, D z) { return z - s.level - s.slope * (u - s.edge_u) - s.grade * (x - plane_x); };  // the stubble
auto crossing = [&](const Ray& ray, D height) {  // where a ray is at a height above the stubble side, moved to the foot
  D falls = ray.aim[2] - s.slope * ray.aim[1] - s.grade * ray.aim[0];
  falls = falls <= LEAST_FALL ? falls : LEAST_FALL;
  D way = (height - above(ray.start[0], ray.start[1], ray.start[2])) / falls;
  way = clamped(way, 0.0, FAR + FAR);
  return place(ray.start[0] + ray.aim[0] * way - step.ahead * height, ray.start[1] + ray.aim[1] * way - rise * height);
};
Answer* answers = (Answer*)m.answers.data + (int)b.rays;
const int n = (int)s.falling;
int middle = 0;
D sum_along = 0.0;
for (int i = 0; i < n; ++i) {
  const Ray& ray = rays[i];
  const Place upper = crossing(ray, track.height);
  Place end = crossing(ray, limit);
  D height = __builtin_nan(""), ahead = height;
  const D lower = end.beside, r = ray.distance;
  int kind = NOTHING;
  if (r < NEAR) {
    kind = AIR;
  } else if (r == r) {
    const D x = ray.start[0] + ray.aim[0] * r, u = ray.start[1] + ray.aim[1] * r;
    height = above(x, u, ray.start[2] + ray.aim[2] * r);
    if (height > HEADROOM * track.height + ROOM) {
      kind = DUST;
    } else {
      kind = (int)clamped((height - LOWEST) / LAYER, 0.0, LAYERS - 1.0);
      if (height > limit) {
        end = place(x - step.ahead * height, u - rise * height);
        ahead = end.along;
      }
    }
  }
  answers[i] = Answer{height, upper.beside, lower, ray.stands, -1.0, ahead, b.next};
  const D through = end.beside - upper.beside;
  const Place inner = through > 0.0 ? end : upper;
  const D back = through > 0.0 ? smaller(through, INWARD) : smaller(-OUTWARD_SHARE * through, OUTWARD);
  const D beside = inner.beside - back, cell = __builtin_floor((beside + HALF) / CELL);
  if (!(cell >= 0.0 && cell < PLACES)) continue;
  const int at = (int)cell * CLASSES + kind;
  answers[i].cell = at;
  m.counts.data[at] += 1.0;
  if (ray.stands != 0.0) m.solid.data[at] += 1.0;
  if (!(__builtin_fabs(beside) < 1.0)) continue;
  sum_along += inner.along;
  ++middle;
}
++b.next;
++b.scans;
b.rays += n;
b.travel += s.travel;
b.lost += s.travel;
b.along += sum_along;
b.near += middle;
b.rise = rise;
b.across = s.across;
s.is_full = b.travel >= BLOCK;
return ((int)b.rays + beam_count) * (int)(sizeof(Answer) / sizeof(D)) > m.answers.shape[0];
