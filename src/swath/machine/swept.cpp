// Before the body of a native function: what a line sweeps over between two positions of it, see `sweep.Sweeps`.
//
// A position is x, y of the left end and of the right one.

struct Point { double x, y; };
struct Polygon { double corners, area, more; Point at[4]; };
auto ends_at = [](const double* pose, const double* line, Point* ends) {  // of a pose of 12 numbers; line: x, left and right y
  for (int n = 0; n < 2; ++n) ends[n] = {pose[3] * line[0] + pose[4] * line[1 + n] + pose[0], pose[6] * line[0] + pose[7] * line[1 + n] + pose[1]};
};
auto signed_area = [](const Polygon& of) {  // [m2], > 0 when anticlockwise
  const Point* p = of.at;
  double twice = 0.0;
  for (int k = 2; k < (int)of.corners; ++k) twice += (p[k - 1].x - p->x) * (p[k].y - p->y) - (p[k - 1].y - p->y) * (p[k].x - p->x);
  return 0.5 * twice;
};
auto between = [&](const Point* before, const Point* after, Polygon* to) -> int {  // the number of polygons
  const Point a = before[0], b = before[1], c = after[1], d = after[0];
  const auto way = [](const Point& from, const Point& to) -> Point { return {to.x - from.x, to.y - from.y}; };
  const auto cross = [](const Point& p, const Point& q) { return p.x * q.y - p.y * q.x; };
  const Point old = way(a, b), now = way(d, c), left = way(a, d), right = way(b, c), back = way(c, d), home = way(d, a);
  const double turns[4] = {cross(old, right), cross(right, back), cross(back, home), cross(home, old)};
  Polygon parts[2] = {{4.0, 0.0, 0.0, {a, b, c, d}}};
  int count = 1, falls = 0, rises = 0;
  for (const double turn : turns) rises += turn >= 0.0, falls += turn <= 0.0;
  const double across = cross(old, now), s = cross(left, now) / across, u = cross(left, old) / across;
  if (__builtin_fabs(across) >= 1e-15 && 0.0 < s && s < 1.0 && 0.0 < u && u < 1.0) {  // it turned about a point of its own
    const Point pivot = {a.x + s * old.x, a.y + s * old.y};
    parts[0] = {3.0, 0.0, 0.0, {a, pivot, d}}, parts[1] = {3.0, 0.0, 0.0, {b, c, pivot}}, count = 2;
  } else if (rises < 4 && falls < 4) {  // a dent: split along the diagonal that lies inside
    const Point thirds[4][3] = {{a, b, c}, {a, c, d}, {b, c, d}, {b, d, a}};
    Polygon halves[4];
    double areas[4];
    for (int k = 0; k < 4; ++k) {
      halves[k] = {3.0, 0.0, 0.0, {thirds[k][0], thirds[k][1], thirds[k][2]}};
      areas[k] = __builtin_fabs(signed_area(halves[k]));
    }
    const Polygon* less = areas[2] + areas[3] < areas[0] + areas[1] ? halves + 2 : halves;
    parts[0] = less[0], parts[1] = less[1], count = 2;
  }
  Polygon* next = to;
  for (int k = 0; k < count; ++k) {
    const double area = signed_area(parts[k]);
    if (!(__builtin_fabs(area) > 1e-9)) continue;
    const int corners = (int)parts[k].corners;
    *next = parts[k];
    for (int n = 0; area < 0.0 && n < corners; ++n) next->at[n] = parts[k].at[corners - 1 - n];
    next->area = signed_area(*next);
    ++next;
  }
  return (int)(next - to);
};
