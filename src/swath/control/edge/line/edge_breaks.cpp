// Where an edge breaks off: into a hole of the crop, outward at the next tooth, or inward for good.
constexpr D LEAST_GAIN = 6.0, LEAD = 5.0;  // nat of an edge over none; by which a place outside the gate shows that the edge broke off
constexpr D WIDEST = 0.8, OUT = 0.2;       // m beside the track that a gate may reach; m: a step outward
constexpr D FLANK = 0.17, RAGGEDS = 3.0;  // m inward, or of the scatter: a step
constexpr D CHANCE = 4.0;      // standard deviations of block and line, within which a step is none
constexpr D HOLE = 0.3, NEARER = 0.5;  // m inward from which on an edge beside a line that broke off is a hole's; part of it
constexpr D NOISE = 0.03, GROWS = 0.08, STAYS = 2.0;  // m between blocks, in all: crop stands out ever further; along which it does
constexpr D SUNKEN = 0.25, LONG = 7.0;  // of the crop's height; m of travel along a wall after which it is the edge
constexpr D NEAREST = 0.25, FARTHEST = 0.9, JUMP = 0.15;  // m beside the line; m by which a block may lie off the newest ones
constexpr int BENDS = 3, NEWEST = 5, FEWEST_WALLS = 3;    // blocks that show a bend, those, that show a wall
constexpr D ROUGH = 0.06, PARALLEL_WALL = 0.06;  // m, root mean square about its line; rad to the line that broke off

// An edge further in than a line that broke off: the wall of a hole, or the edge itself from now on.
//
// Both look alike until a hole ends. A wall that has gone on beside the line, straight and at one distance, for longer than a hole
// that is bridged, is the edge: another header width was driven before, or a strip missed. rows: the newest WALLS blocks: distance
// beside the line [m], x, u [m], variance [m2], distance along the line [m]
struct InnerEdge : InnerEdgeRow {
  void clear() { count = 0.0; }
  D* row(int k) { return rows + 5 * k; }
  void add(D beside, const D* at, D variance, D distance) {
    if (!(NEAREST < beside && beside < FARTHEST)) return clear();
    if (count > 0.0) {
      D newest[NEWEST];
      const int n = count < NEWEST ? (int)count : NEWEST;
      for (int k = 0; k < n; ++k) newest[k] = row((int)count - n + k)[0];
      if (__builtin_fabs(beside - Np::median(newest, n)) > JUMP) clear();
    }
    const D last[5] = {beside, at[0], at[1], variance, distance};
    push(rows, count, 5, WALLS, last);
  }
  bool is_seen() const { return count >= FEWEST_WALLS; }  // a wall goes along the line
  // whether it is the edge: then beside the line at the newest block [m], angle to it [rad]
  bool line(D& at, D& slope) {
    const int n = (int)count;
    if (n < FEWEST_WALLS || row(n - 1)[4] - row(0)[4] < LONG) return false;
    auto distance = [&](int i) { return row(i)[4] - row(n - 1)[4]; };
    const D middle = sum_of(n, distance) / n;
    auto apart = [&](int i) { return distance(i) - middle; };
    slope = sum_of(n, [&](int i) { return apart(i) * row(i)[0]; }) / sum_of(n, [&](int i) { return apart(i) * apart(i); });
    at = sum_of(n, [&](int i) { return row(i)[0]; }) / n - slope * middle;
    auto about = [&](int i) { return row(i)[0] - at - slope * distance(i); };
    const D all = sum_of(n, [&](int i) { return about(i) * about(i); });
    return !(__builtin_fabs(slope) > PARALLEL_WALL || __builtin_sqrt(all / n) > ROUGH);
  }
};

// What is seen beside a line that broke off. hole: where another edge was seen [m], nan = nowhere; beside: the track, the last block
// that fitted [m]; outside: blocks ever further outside a line along bites: how many, the first one and its distance, the last one
// [m]; inner: the edge that goes on there
struct EdgeBreaks : EdgeBreaksRow {
  void end() {  // the line goes on
    hole = NO_NUMBER;
    inner.clear();
  }
  // The edge steps into the crop, or still stands where it was seen when the line broke off. Steps outward are left to the gate:
  // behind a tooth, crop that stands out is the edge.
  //
  // scatter: of the blocks about the line [m2]; row: of the crop to the next one [m], where one ends in a bend across them the edge
  // steps; is_even: they fitted it, and the edge has no bites
  bool is_hole(const Found& found, const Arc& arc, D scatter, D row, bool is_even) const {
    const D inward = found.lead < LEAD ? found.beside : found.best;
    if (hole > 0.0) return inward > larger(larger(HOLE, row), NEARER * hole);
    const D own = __builtin_sqrt(found.variance + arc.covariance[0]);  // thin stands show a block less well
    const D step = larger(larger(FLANK, row), RAGGEDS * __builtin_sqrt(scatter));
    return is_even && arc.unseen < 1.0 && inward > larger(step, CHANCE * own);
  }
  // Crop stands out beside a line that fitted so far: the edge has bites, and here it is, outside, in the place of `found`.
  bool step_out(Found& found, const Block& block, const D* worth) const {
    if (!(beside > -0.5 * OUT && -WIDEST <= found.best && found.best < -OUT)) return false;
    const Found wide = block.find_edge(worth, WIDEST, INFINITE);
    if (!(wide.gain >= LEAST_GAIN && wide.lead < LEAD && wide.beside < -OUT)) return false;
    found = wide;
    return true;
  }
  // Whether an edge leaves a line of bites outward, far or for long, and from which distance along it on [m]. Bites come back to the
  // line: of teeth and saws of up to 0.6 m single blocks lie so far outside it.
  bool bends_away(const Found& found, D distance, bool has_bites, D& since) {
    const D place = found.lead < LEAD ? found.beside : found.best;
    if (!has_bites || place > -OUT || found.gain + found.lead < LEAST_GAIN) {
      outside_count = 0.0;
      return false;
    }
    if (!(outside_count > 0.0 && place < outside_last + NOISE)) outside_count = 0.0, outside_first = place, outside_since = distance;
    outside_count += 1.0;
    outside_last = place;
    since = outside_since;
    if (outside_count < BENDS || (place > outside_first - GROWS && distance < since + STAYS)) return false;
    outside_count = 0.0;
    return true;
  }
  bool follow(const Found& found, const ArcTrack& track, bool is_inside) {  // whether another edge is seen that goes on beside the line
    if (track.has_arc == 0.0 || !is_inside || found.gain + found.lead < LEAST_GAIN) {
      inner.clear();
      return false;
    }
    D at[2];
    track.arc.beside(found.best, at);
    inner.add(found.best, at, found.variance, track.arc.distance);
    return true;
  }
  // Behind the edge the rays end lower than further in: they go on over a hole to its far wall. height: of the crop [m]
  static bool is_sunken(const Block& block, const Found& found, D height) {
    D near[CLASSES], inner[CLASSES];
    block.between(block.counts, found.beside + 0.1, found.beside + 0.6, near);
    block.between(block.counts, found.beside + 1.2, found.beside + 2.4, inner);
    return Layers::median(inner) - Layers::median(near) > SUNKEN * height;
  }
};
