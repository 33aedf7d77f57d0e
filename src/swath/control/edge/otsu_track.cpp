// The track of edge points over several scans and the line through them.
//
// It coasts over short gaps with a falling confidence, gives up after `lost_s`, and takes a new edge only after it was seen for a while:
// longer when that lies beside the one it remembers (a notch, a tramline).
struct Point { D x, u, variance, quality, age, is_used, slope; };
// Parabola through n points in scratch by reweighted least squares; leaves the weights there.
static constexpr auto fit_line = [](D* const* row, int n, Line line, D x0) __attribute__((noinline)) {
  const D *x = row[FIT_X], *u = row[FIT_U], *variance = row[FIT_VARIANCE];
  D *robust = row[ROBUST], *values = row[VALUES], *off = row[MET];
  if (!line.is_there) line.offset = median(copy(u, n, values), n), line.slope = line.bend = 0.0;
  line.x0 = x0;
  line.is_there = true;
  for (int turn = 0; turn < 4; ++turn) {
    for (int i = 0; i < n; ++i) values[i] = __builtin_fabs(off[i] = u[i] - line.at(x[i]));
    D spread = MAD * median(values, n), total = 0.0;
    spread = spread * spread;
    for (int i = 0; i < n; ++i) {
      const D rest = larger(1.0 - off[i] * off[i] / (TUKEY * TUKEY * (variance[i] + spread)), 0.0);
      robust[i] = rest * rest;
      total += robust[i];
    }
    for (int i = 0; total < 0.5 && i < n; ++i) robust[i] = 1.0;
    D a = 0.0, b = 0.0, c = 0.0, d = 0.0, e = 0.0, p = 0.0, q = 0.0, r = 0.0;
    for (int i = 0; i < n; ++i) {  // the normal matrix (a b c; b m e; c e g) with g = sum of (half square) squares
      const D w = robust[i] / variance[i], ahead = x[i] - x0, square = 0.5 * ahead * ahead;
      a += w;
      b += w * ahead;
      c += w * square;
      e += w * ahead * square;
      d += w * square * square;
      p += w * u[i];
      q += w * ahead * u[i];
      r += w * square * u[i];
    }
    D m = 2.0 * c + 1.0 / (SLOPE_SD * SLOPE_SD), g = d + 1.0 / (BEND_SD * BEND_SD);  // squares of ahead are twice `square`
    D share = b / a;
    m = m - share * b;
    const D mixed = e - share * c;
    q = q - share * p;
    share = c / a;
    g = g - share * c;
    r = r - share * p;
    share = mixed / m;
    line.bend = (r - share * q) / (g - share * mixed);
    line.slope = (q - mixed * line.bend) / m;
    line.offset = (p - b * line.slope - c * line.bend) / a;
  }
  return line;
};
static constexpr auto carried = [](const Line& line, D distance, D turn) {  // seen from where the machine is then
  const D offset = line.offset + distance * (line.slope + 0.5 * line.bend * distance), slope = line.slope + line.bend * distance;
  return Line{line.x0, offset - line.x0 * turn + slope * offset * turn, slope - turn * (1.0 + slope * slope), line.bend, line.is_there};
};
static constexpr auto line_of = [](const auto& state) {
  return Line{state.x0, state.offset, state.slope, state.bend, state.is_there > 0.0};
};
static constexpr auto follow = [](auto& state, const Line& line) {
  state.x0 = line.x0, state.offset = line.offset, state.slope = line.slope, state.bend = line.bend, state.is_there = line.is_there;
};
static constexpr auto slope_at = [](const auto& state, D x) {
  return state.is_there > 0.0 ? state.slope + state.bend * (x - state.x0) : 0.0;
};
// Through the points that count.
static constexpr auto fit_used = [](const Point* points, D* const* row, auto& state, D x0) __attribute__((noinline)) {
  int n = 0;
  for (int i = 0; i < state.rows; ++i) {
    const Point& point = points[i];
    if (!(point.is_used > 0.0)) continue;
    const D lean = LEVER * (point.slope - slope_at(state, point.x));
    row[FIT_X][n] = point.x;
    row[FIT_U][n] = point.u;
    row[FIT_VARIANCE][n++] = PER_SAMPLE * point.variance + lean * lean;
  }
  follow(state, fit_line(row, n, line_of(state), x0));
};
// Found when enough scans of the last `span` [s] agree on one line, near one if that is there.
static constexpr auto try_line = [](Point* points, D* const* row, auto& state, D span, const Line& near,
                                    const auto& s) __attribute__((noinline)) {
  if (state.unseen < span - SMALL && !near.is_there) return;
  int asked = 0, n = 0, agree = 0, next = 0;
  D oldest = 0.0;
  auto is_of = [&](const Point& point) { return point.age <= span + SMALL; };
  auto is_seen = [&](const Point& point) { return is_of(point) && __builtin_isfinite(point.x); };
  for (int i = 0; i < state.rows; ++i) {
    const Point& point = points[i];
    oldest = larger(oldest, point.age);
    asked += is_of(point);
    if (!is_seen(point)) continue;
    row[FIT_X][n] = point.x;
    row[FIT_U][n] = point.u;
    row[FIT_VARIANCE][n++] = point.variance;
  }
  const D fewest = larger(3.0, MIN_SHARE * asked);
  if (oldest < span - SMALL || n < fewest) return;
  const Line line = fit_line(row, n, near, s.reference), about = near.is_there ? near : line;
  for (int i = 0; i < n; ++i) {
    const bool is_close = __builtin_fabs(row[FIT_U][i] - about.at(row[FIT_X][i])) < s.gate;
    if (row[ROBUST][i] > 0.0 && is_close) ++agree;
    else row[ROBUST][i] = 0.0;
  }
  if (agree < fewest) return;
  for (int i = 0; i < state.rows; ++i) points[i].is_used = is_seen(points[i]) && row[ROBUST][next++] > 0.0;
  state.is_found = 1.0;
  state.unseen = 0.0;
  follow(state, line);
  fit_used(points, row, state, s.reference);
};
// The points and the line, seen from where the machine is now.
static constexpr auto move_track = [](Point* points, auto& state, D distance, D turn, D seconds, D crab, const auto& s) {
  const D course = 0.5 * turn + crab, dx = distance * ::cos(course), du = distance * ::sin(course), c = ::cos(turn), t = ::sin(turn);
  D front = -INFINITE;
  for (int i = 0; i < state.rows; ++i) {
    Point& point = points[i];
    const D x = point.x - dx, u = point.u - du;
    point.x = c * x + t * u;
    point.u = c * u - t * x;
    point.age = point.age + seconds;
    point.slope = point.slope - turn;
    if (point.x > front) front = point.x;
  }
  if (front == -INFINITE) front = 0.0;
  int n = 0;
  for (int i = 0; i < state.rows; ++i)
    if (points[i].age <= WINDOW_S && !(points[i].x < front - s.track)) points[n++] = points[i];
  state.rows = n;
  state.unseen = state.unseen + seconds;
  if (!(state.is_there > 0.0)) return;
  follow(state, carried(line_of(state), distance, turn));
  state.offset = state.offset - distance * crab;
  if (state.unseen > FORGET_S) state.is_there = state.is_found = 0.0;
};
// Take the edge point of a scan, or that it showed none. room: for points
static constexpr auto update_track = [](Point* points, int room, D* const* row, auto& state, const Step& step,
                                        const auto& s) __attribute__((noinline)) {
  int n = state.rows;
  for (int i = 1; n == room && i < n; ++i) points[i - 1] = points[i];
  if (n == room) --n;
  Point& point = points[n] = {NO_NUMBER, NO_NUMBER, NO_NUMBER, NO_NUMBER, 0.0, 0.0, NO_NUMBER};
  if (step.is_there) {
    point = {step.x, step.u, step.variance, step.quality, 0.0, 0.0, slope_at(state, step.x)};
    const D off = __builtin_fabs(step.u - line_of(state).at(step.x));
    point.is_used = state.is_there > 0.0 && state.is_found > 0.0 && off < s.gate;
  }
  state.rows = n + 1;
  if (point.is_used > 0.0) {
    state.unseen = 0.0;
    fit_used(points, row, state, s.reference);
  } else if (state.is_found > 0.0 && state.unseen > s.lost_s) {
    state.is_found = 0.0;
    for (int i = 0; i <= n; ++i) points[i].is_used = 0.0;
  }
  Line near = line_of(state);
  if (state.is_found == 0.0) try_line(points, row, state, s.acquire_s, near, s);
  if (state.is_found == 0.0 && near.is_there) near.is_there = false, try_line(points, row, state, s.jump_s, near, s);
};
// Share of the last half second of scans that show the edge, times their quality.
static constexpr auto confidence_of = [](const Point* points, const auto& state, const auto& s) __attribute__((noinline)) {
  int recent = 0, used = 0;
  D quality = 0.0;
  for (int i = 0; i < state.rows; ++i) {
    if (!(points[i].age <= 0.5)) continue;
    ++recent;
    if (points[i].is_used > 0.0) ++used, quality += points[i].quality;
  }
  if (used == 0) return 0.0;
  const D fading = larger(0.0, 1.0 - state.unseen / (s.lost_s + TINY));
  return smaller(larger((D)used / recent * (quality / used) * fading, LEAST_SURE), 1.0);
};
// How far the feet are behind the canopy's edge before anything is learned [m].
static constexpr auto guess_of = [](const auto& s, D height) { return s.lean * larger(height, 0.0) + s.spot; };
