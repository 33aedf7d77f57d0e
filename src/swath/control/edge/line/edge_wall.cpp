// The wall of an edge: where along it the outermost crop stops rays, and what bites that does show.
//
// In a bend away from the crop the rays run along the edge and meet it from outside, up to 2 m from the middle of the block. In one
// toward the crop they come out of it, and no wall is seen. Along an even edge the wall lies as far ahead of the middle from block to
// block; bites behind what stands out are not seen themselves, but the rays then meet the faces of the teeth, now nearer, now further
// ahead.
constexpr D STRIP_FROM = -0.05, STRIP_TO = 0.2;  // m beside the edge, where so many echoes show the wall:
constexpr int ENOUGH = 4, TURNING = 3;           // and blocks from which the edge turned away
constexpr D ASLANT = 0.2, ALONG_EDGE = 0.4;  // rad away from the crop, from which on and beyond which rays run along the edge
constexpr D JAGGED_M = 6.0, USUAL_M = 15.0;  // m of travel over which it is seen how jagged the edge is, and what is usual
constexpr D TURNS_M = 6.0, TURNED_FROM = 0.08, TURNED_TO = 0.2, LEAST_MOVE = 0.02;  // m of the edge behind; rad, m: it turns away since
constexpr D EVEN_WALL = 0.21;  // of the crop's height, over which rays come down: standard deviation of where an even wall lies

// Mean of where the outermost crop stops rays, along the edge [m], and its variance [m2]; nan: unseen.
struct Wall {
  D along, variance;

  // of an edge `beside` the frame [m] in the rays of a block; room: for as many numbers as there are rays
  static Wall of(const Block& block, D beside, D* room) {
    const D first = whole_of((beside + STRIP_FROM + HALF) / CELL) * CLASSES;
    const D last = whole_of((beside + STRIP_TO + HALF) / CELL) * CLASSES;
    int n = 0;
    for (int k = 0; k < block.row.rays; ++k) {
      const Answer& echo = block.answers[k];
      if (echo.cell >= first && echo.cell < last && __builtin_isfinite(echo.ahead)) room[n++] = echo.ahead;
    }
    if (n < ENOUGH) return Wall{NO_NUMBER, NO_NUMBER};
    const D mean = mean_of(room, n);
    for (int k = 0; k < n; ++k) room[k] = (room[k] - mean) * (room[k] - mean);
    return Wall{mean, block.alike() * mean_of(room, n) / n};
  }
  // How far ahead along the track a block's edge lies [m]: in the middle of its rays, or at its wall. angle: of the track to the
  // machine, < 0 away from the crop [rad]
  D place_along(D middle, D angle) const {
    const D share = within(0.0, (-angle - ASLANT) / (ALONG_EDGE - ASLANT), 1.0);
    return share > 0.0 && __builtin_isfinite(along) ? middle + share * (along - middle) : middle;
  }
};

// How far ahead of the middles of their blocks the walls of the last metres lie. While an edge goes straight on that says nothing.
// Where it has turned away since, they are where it was.
//
// rows: the newest WALLS: distance of the block along the track [m], angle of the track there [rad], the wall ahead of it [m], and how
// much of that its point was moved [m]
struct WallsBehind : WallsBehindRow {
  void clear() { count = 0.0; }
  void add(D distance, D angle, D ahead) {  // a block: distance along the track [m], angle [rad], how far ahead its wall is [m]
    const D row[4] = {distance, angle, ahead, 0.0};
    keep(rows, count, 4, 0, distance - TURNS_M, INFINITE);
    push(rows, count, 4, WALLS, row);
  }
  // Points along an edge that turns move to its wall, and with them those of blocks. angle: of the track at its newest block [rad]; given
  // back: the distance of the first of them along the edge [m], nan where none moves
  __attribute__((noinline)) D move(EdgePoints& points, D angle) {
    auto share = [&](const D* row) { return within(0.0, (row[1] - angle - TURNED_FROM) / (TURNED_TO - TURNED_FROM), 1.0); };
    int turning = 0;
    D first = NO_NUMBER;
    for (int k = 0; k < count; ++k) turning += share(rows + 4 * k) != 0.0;
    for (int k = 0; turning >= TURNING && k < count; ++k) {
      D* row = rows + 4 * k;
      const D part = share(row), more = part * row[2] - row[3], distance = row[0] + row[3];
      if (!(part * __builtin_fabs(row[2]) > __builtin_fabs(row[3]) + LEAST_MOVE)) continue;
      row[3] += more;
      points.move(distance, more * ::cos(row[1]), more * ::sin(row[1]), more);
      if (!(distance >= first)) first = distance;
    }
    return first;
  }
};

// How far to and fro the wall lies, from block to block. variance [m2], beyond what chance gives; usual: ahead of the middle [m]
struct JaggedWall : JaggedWallRow {
  void clear() { variance = 0.0, usual = NO_NUMBER; }
  // A block's wall, middle of its rays [m] and travel [m]; angle: of the track to the machine [rad]. Of a wall aslant nothing is
  // reported, and what was seen is forgotten.
  void add(const Wall& wall, D middle, D angle, D travel) {
    const D late = smaller(1.0, travel / JAGGED_M), seldom = smaller(1.0, travel / USUAL_M);
    if (__builtin_fabs(angle) > ASLANT) {
      variance = (1.0 - late) * variance, usual = NO_NUMBER;
    } else if (__builtin_isfinite(wall.along)) {
      const D ahead = wall.along - middle;
      if (!__builtin_isfinite(usual)) usual = ahead;
      const D away = square(ahead - usual);
      variance += late * (larger(0.0, away - wall.variance) - variance);
      usual += seldom * (ahead - usual);
    }
  }
  // how much more than along an even edge the wall lies to and fro, standard deviation [m]; height: of the crop over the stubble [m]
  D swing(D height) const { return __builtin_sqrt(larger(0.0, variance - square(EVEN_WALL * height))); }
};
