// A scan of a world into its track, where it is new. In: time of the scan [ns]; speed [m/s], yaw rate [rad/s], rise of tops of plants
// toward the left and whether that is known; its ranges, beams and mounting. Given back: how many rays, in rows UPPER, LOWER and LEVEL of the scratch, say how far the feet are behind the canopy's edge, 0 = none; told: their
// ground, top, limit, first guess of that, and whether it is to be fitted.
const auto& s = wp::index(settings, w);
auto& state = wp::index(states, w);
Point* points = (Point*)track.data;
D* row[SCRATCH];
for (int k = 0; k < SCRATCH; ++k) row[k] = scratch.data + k * scratch.shape[1];
if (stamp <= state.time) return 0;
const D seconds = (stamp - state.time) / NS, travel = speed * seconds;
state.time = stamp;
move_track(points, state, travel, s.sign * yaw_rate * seconds, seconds, -s.sign * (CRAB * (rise + speed * yaw_rate / GRAVITY)), s);
if (s.memory > 0.0 && travel > 0.0) {
  const D keep = ::exp(-travel / s.memory);
  for (int i = 0; i < seen.shape[0] * seen.shape[1]; ++i) seen.data[i] = seen.data[i] * keep;
  for (int i = 0; i < heights.shape[0]; ++i) heights.data[i] = heights.data[i] * keep;
  state.since = state.since + travel;
}
int echoes = 0;
const D* m = mounting.data;
for (int i = 0; i < ranges.shape[0]; ++i) {
  const D far = wp::index(ranges, i);
  if (!(far > NEAR && far < FAR)) continue;
  const auto d = wp::index(directions, i);
  const D px = m[0] + far * (m[3] * d[0] + m[4] * d[1] + m[5] * d[2]);
  const D py = m[1] + far * (m[6] * d[0] + m[7] * d[1] + m[8] * d[2]);
  const D pz = m[2] + far * (m[9] * d[0] + m[10] * d[1] + m[11] * d[2]);
  if (!(pz > LOWEST && pz < HIGHEST)) continue;
  const D back = wp::index(ago, i), turn = yaw_rate * back, z = turn * turn;
  const bool is_far = __builtin_fabs(turn) > 0.01;  // to 1e-16 up to there
  const D c = is_far ? ::cos(turn) : 1.0 - 0.5 * z * (1.0 - z / 12.0 * (1.0 - z / 30.0));
  const D t = is_far ? ::sin(turn) : turn * (1.0 - z / 6.0 * (1.0 - z / 20.0 * (1.0 - z / 42.0)));
  row[ECHO_X][echoes] = speed * back + c * px - t * py;
  row[ECHO_U][echoes] = s.sign * (0.5 * speed * back * turn + t * px + c * py);
  row[ECHO_Z][echoes++] = pz;
}
const D sensor[] = {m[0], s.sign * m[1], m[2]}, aside = is_known ? s.sign * rise : NO_NUMBER;
const Line before = line_of(state);
const bool was_found = state.is_found > 0.0, is_met = was_found && __builtin_isfinite(state.crop);
const D tops[] = {is_met ? state.ground + HEADROOM * larger(state.crop, 0.0) + ROOM : HIGHEST, FIRST_TOP, SECOND_TOP};
Step best{};
for (int k = 0; k < (is_met ? 1 : 3); ++k) {
  const Step step = find_step(s, before, echoes, tops[k], aside, sensor, row, indices.data, indices.data + indices.shape[0] / 2);
  if (step.is_there && (!best.is_there || step.separation > CLEARER * best.separation)) best = step;
}
update_track(points, track.shape[0], row, state, best, s);
if (!best.is_there) return 0;
const bool is_known_crop = __builtin_isfinite(state.crop);
auto later = [&](D& kept, D now) { kept = is_known_crop ? (1.0 - LATE) * kept + LATE * now : now; };
later(state.crop, best.crop);
later(state.stubble, best.stubble);
later(state.ground, best.ground);
if (!was_found || !before.is_there || s.memory <= 0.0 || __builtin_fabs(best.u - before.at(best.x)) > CLOSE) return 0;
const D all[] = {best.ground, best.top, best.limit, guess_of(s, state.crop), (D)(state.since >= OFTEN && state.crop > 0.0)};
copy(all, 5, told.data);
return best.count;
