// What a line sweeps over on the way of a step, run by run of its points: the body of one native function (crop_kernel.py).
//
// In: of `its` poses of a trail, or `lines` (world, k, points, 2), of each world `counts` of them; `runs` (world, n, 3) first point, last
// point, code, a first point below 0 ends them; `steps`: positions closer together than this are joined [m]. Out: `polygons`, `found` of
// them. `last`: (world, 1 + 2 points) 1 once the line was anywhere, and where it was last.

constexpr double STILL = 1e-6;  // a line that moves less stands [m]
const bool has_poses = its.poses.data;
const int points = its.lines.shape[2], given = has_poses ? (int)its.head.data[1] : its.counts.data[w], count = its.active.data[w] ? given : 0;
double* is_known = its.last.data + (1 + 2 * points) * w;
Point* old = (Point*)(is_known + 1);
Polygon* next = (Polygon*)its.polygons.data + (long long)its.polygons.shape[1] * w;
const Polygon* first = next;
for (int k = 0; k < count; ++k) {
  Point* now = (Point*)its.lines.data + ((long long)its.lines.shape[1] * w + k) * points;
  if (has_poses) ends_at((const double*)((const char*)its.poses.data + k * (long long)its.poses.strides[0] + w * its.poses.strides[1]), its.knives.data + 3 * w, now);
  const double step = its.steps.data[w], still = step < 0.0 ? 0.0 : STILL, least = k < count - 1 && step > still ? step : still;
  bool moves = false;
  for (int n = 0; n < points && !moves && *is_known; ++n) {
    const double way[2] = {now[n].x - old[n].x, now[n].y - old[n].y};
    moves = exact_length(way, 2) >= least;
  }
  const int* run = its.runs.data + 3 * its.runs.shape[1] * w;
  for (int r = 0; moves && r < its.runs.shape[1] && run[0] >= 0; ++r, run += 3) {
    const Point before[2] = {old[run[0]], old[run[1]]}, after[2] = {now[run[0]], now[run[1]]};
    for (int more = between(before, after, next); more > 0; --more) next++->more = run[2];
  }
  if (moves || !*is_known) __builtin_memcpy(old, now, points * sizeof *now), *is_known = 1.0;
}
its.found.data[w] = (int)(next - first);
