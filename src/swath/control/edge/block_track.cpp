// From blocks of rays to a track of the edge: where it begins, goes on, breaks off, or cannot be seen.
constexpr D AHEAD_M = 4.0;     // m that blocks lie ahead of where the edge is reported
constexpr D LONGEST = 1.2;     // m of travel of a block that says little
constexpr D FIRST_M = 4.0;     // m of travel whose rays add up while there is no edge: so far one is straight, estimated
constexpr int BEGIN = 3, YOUNG = 6;  // blocks of an edge that is told: a line through two shows no error; that may show a false start
constexpr D GATE = 0.28, WIDENING = 0.025;  // m, 1/m: + WIDENING times the square of the distance unseen
constexpr D BLURRED = 0.08, BROAD = 0.5;    // m, deviation of a block's edge in dust from which on the gate is as wide; m
constexpr D BEGIN_GAIN = 20.0;                    // nat of two populations over one, at first
constexpr D MOST_ALIKE = 0.93, MORE_CROP = 0.03;  // overlap of both sides' classes; share of rays that only crop stops
constexpr D TALL = 0.5;    // of the height that crop was taken to have: echoes above are crop,
constexpr int MANY = 100;  // and so many show how high it stands
constexpr D LEARNED = 0.15, RISES = 0.09;  // m beside the track: blocks further off teach nothing; m by which a front of crop rises
constexpr D RAGGED_M = 6.0;       // m of travel over which it is seen how ragged the edge is
constexpr D RELIC_M = 15.0, ELSEWHERE = 0.8, TURNED = 0.5;  // m that a lost line is remembered; m, rad from it: another edge
constexpr D DEEP = 0.2, SHALLOW = 0.1;   // m: bites that are followed no more; that are none
constexpr D STEPS = 0.41, SLIGHT = 0.07, PARALLEL = 0.1;  // of the crop's height that the wall lies to and fro, m, rad: bites, too
constexpr D FADING = 10.0, ALONG = 0.3;  // m, over which bites are forgotten; rad from the heading: beyond it is a bend
constexpr D USED = 0.9;         // share of late blocks that fitted, from which on a step is one
constexpr D FLAT_INSIDE = 0.2;  // of the counts in lodged crop that are learned; all of those beside it
constexpr D LEAST_ABOVE = 0.3;  // m between the headroom and the scanner, own choice: no share of dust is divided by less
constexpr D DOUBT = 1.2;        // of the swing of lodged tops: standard deviation of a block there

// spread: standard deviation of where the edge begins, forget: unseen for so long it is lost, spacing: of the rows that the crop stands
// in, 0 = none, view: height of the scanner [m]
//
// height: of the crop, that rays were cut with [m]; agreed: share 0..1 of late blocks that fitted; scatter: of the blocks about the
// track, beyond their own variance [m2]; blank: mean width of the strip about the edge between the rays that show it [m]; followed:
// blocks since the edge began; bite: how deep the bites of the edge are [m], along which the track is smooth, 0 where it follows them;
// turn_sd: standard deviation of its angle there [rad]; is_broken: the last blocks showed no standing edge near the track; scatters:
// distance, scatter and variance of the wall before each of the last blocks; bends: distance along the edge [m] before which it says
// nothing of bites; lost: the track before; headed: heading where the block began [rad]
struct BlockTrack : BlockTrackRow {
  D crop_height() const {
    const D seen = populations.top();
    return __builtin_isfinite(seen) ? within(0.15, seen, 2.5) : USUAL_HEIGHT;
  }
  // of blocks about the line, beyond their own variance [m2]; of rows, whole ones come and go
  D noise() const { return scatter + square(spacing) / 12.0; }
  // A block is full: is_done, or it goes on. frame: the edge as the machine sees it; room: for as many numbers as it has rays
  void look(Block& block, const EdgeFrame& frame, const At& at, D* room) {
    accepted.is_seen = 0.0;
    if (track.has_arc == 0.0 && is_taller(block, room)) {
      is_done = 1.0;
    } else if (track.has_arc == 0.0) {
      is_done = begin(block, frame, at);
      if (block.row.travel > LONGEST && is_done == 0.0) {
        is_done = __builtin_fabs(at.heading - headed) > PARALLEL;
        block.fade(smaller(1.0, FIRST_M / block.row.travel));
      }
    } else if (followed < YOUNG && is_front(block)) {  // what the edge began with was none, or another
      track.clear();
      begin(block, frame, at);
      is_done = 1.0;
    } else {
      is_done = go_on(block, frame, at, room);
    }
    if (is_done != 0.0) headed = at.heading;
  }
  // Most of an unseen crop stands higher than it was taken to: it counts up to there now.
  bool is_taller(const Block& block, D* room) {
    int n = 0;
    for (int k = 0; k < block.row.rays; ++k) {
      const Answer& answer = block.answers[k];
      if (answer.stands > 0.0 && answer.height > TALL * height) room[n++] = answer.height;
    }
    if (n < MANY || Np::median(room, n) < HEADROOM * height) return false;
    const D top = Np::percentile(room, n, 0.9);
    const bool is_higher = top > height;
    height = larger(top, height);
    return is_higher;
  }
  // Look for two populations anywhere near the header end.
  __attribute__((noinline)) bool begin(const Block& block, const EdgeFrame& frame, const At& at) {
    Parted found;
    block.split(spread, found);
    const bool is_edge = found.gain > BEGIN_GAIN && Populations::overlap(found.crop, found.stubble) < MOST_ALIKE;
    if (!(is_edge && Populations::crop_excess(found.crop, found.stubble) > MORE_CROP)) return false;
    if (is_another(block, frame, found.place, at)) return false;
    has_lost = 0.0;
    D sides[4 * CLASSES];
    block.sides(found.place, sides);
    populations.begin(sides);
    height = crop_height();
    D c = ::cos(frame.angle), s = ::sin(frame.angle);
    const D along = block.along(), x = frame.x + c * along - s * found.place, u = frame.u + s * along + c * found.place;
    c = ::cos(at.heading), s = ::sin(at.heading);
    points.clear();
    walls.clear();
    followed = bite = 0.0;
    bends = -INFINITE;
    Arc arc;
    arc.begin(at.x + c * x - s * u, at.u + s * x + c * u, at.heading + frame.angle, 0.0);
    track.begin(arc);
    return true;
  }
  bool is_front(const Block& block) const {  // the crop rises from block to block: what is seen is its front, from a headland before it
    D inside[CLASSES];
    block.between(block.counts, 0.0 + CLEAR, 0.0 + WINDOW, inside);
    return populations.height_of(inside) > height + RISES;
  }
  // An edge that lies beside the line just lost is not that edge, but the far wall of a hole.
  bool is_another(const Block& block, const EdgeFrame& frame, D place, const At& at) const {
    if (has_lost == 0.0 || block.row.lost > RELIC_M) return false;
    const EdgeFrame old = lost.frame(at.x, at.u, at.heading);
    const D beside = frame.u + place - old.u - (frame.x + block.along() - old.x) * ::tan(old.angle);
    return __builtin_fabs(old.angle) < TURNED && __builtin_fabs(beside) > ELSEWHERE;
  }
  // A block is full: where is its edge? False when it needs more rays.
  bool go_on(Block& block, const EdgeFrame& frame, const At& at, D* room) {
    const Arc arc = track.arc;
    D worth[WITHIN];
    const bool is_hazy = weigh(block, worth);
    Found found = find(block, arc, worth, is_hazy);
    if (step_out(block, found, arc, at.heading, worth)) bite = -found.beside;
    const bool is_near = found.lead < LEAD;
    if (followed < YOUNG && !(is_near && found.gain >= LEAST_GAIN) && begin(block, frame, at)) return true;
    if (found.gain < LEAST_GAIN && is_near && block.row.travel < LONGEST) return false;
    followed += 1.0;
    populations.move(block.row.travel);
    const D angle = arc.angle - at.heading;
    const Wall wall = Wall::of(block, found.beside, room);
    const D along = wall.place_along(middle(block), angle);
    const bool is_blind = found.blank > EVENLY * BLURRED || found.variance > BROAD * BROAD;  // it may lie anywhere there
    const D swing = lodging.swing(block, found.beside, populations, angle);
    if (swing > 0.0 && __builtin_fabs(found.beside) < swing + 0.1) {
      pass_lodged(block, found, along, swing);
    } else if (found.gain >= LEAST_GAIN && is_near && !(is_blind || is_hole(found, arc))) {
      accept(block, found, along, at.heading, wall);
    } else {
      const bool broke = !is_near || is_hole(found, arc);
      if (broke) breaks.hole = found.best;
      miss(block, along, broke);
      follow_inner(found, broke);
    }
    bend_away(found);
    height = crop_height();
    return true;
  }
  // What the rays of each place within WINDOW are worth [nat]: dust is as thick in the crop as it is above it. Given back: whether it
  // is dusty about the edge.
  bool weigh(const Block& block, D* worth) const {
    D haze[PLACES], ratios[CLASSES];
    const bool is_dusty = block.haze(haze);
    const D above = larger(view - HEADROOM * height - ROOM, LEAST_ABOVE);
    const Populations::Ratios of = populations.ratios();
    bool is_hazy = false;
    for (int i = 0; i < PLACES; ++i) is_hazy |= __builtin_fabs(Block::place(i)) <= BROAD && haze[i] != 0.0;
    for (int i = 0; i < WITHIN; ++i) {
      if (i == 0 || is_dusty) of.at(haze[FROM + i] * LAYER / above, ratios);
      worth[i] = Np::dot(block.counts + CLASSES * (FROM + i), ratios, CLASSES);
    }
    return is_hazy;
  }
  // The edge of the block within the gate, which shall not cut off what the block says.
  Found find(const Block& block, const Arc& arc, const D* worth, bool is_hazy) const {
    const D bites = bite > 0.0 ? bite + OUT : 0.0;
    const D reach = larger(GATE + WIDENING * square(arc.unseen), bites);
    const D gate = smaller(WIDEST, reach) + spacing;  // where rows end it steps
    const D known = is_hazy ? arc.ahead(block.row.travel).covariance[0] + noise() : INFINITE;
    const Found found = block.find_edge(worth, gate, known);
    const bool is_cut_off = found.variance > BLURRED * BLURRED && found.lead < LEAD && gate < BROAD;
    return is_cut_off ? block.find_edge(worth, BROAD, known) : found;
  }
  // A step outward beside a line that fitted so far, along the machine, in the place of `found`.
  bool step_out(const Block& block, Found& found, const Arc& arc, D heading, const D* worth) const {
    const bool is_used = followed >= YOUNG && arc.unseen < 1.0 && bite == 0.0 && spacing == 0.0;
    return is_used && __builtin_fabs(arc.angle - heading) < ALONG && breaks.step_out(found, block, worth);
  }
  bool is_hole(const Found& found, const Arc& arc) const {
    return breaks.is_hole(found, arc, scatter, spacing, agreed > USED && bite == 0.0);
  }
  static D middle(const Block& block) {  // of the block's rays along the track [m]
    const D along = block.along();
    return __builtin_isfinite(along) ? along : block.row.travel;
  }
  void accept(const Block& block, const Found& found, D along, D heading, const Wall& wall) {
    const D travel = block.row.travel;
    breaks.end();
    breaks.beside = found.beside;
    lodging.stands(block, found.beside, populations);
    if (__builtin_fabs(found.beside) < LEARNED) {
      D sides[4 * CLASSES];
      block.sides(found.beside, sides);
      populations.add(sides);
    }
    track.advance(along);
    const Arc edge = track.arc;
    add_point(edge, found.beside, found.variance);
    const D about = noise();
    D own = 0.0;
    if (is_broken != 0.0) {  // what the track drifted by across the hole is not the edge's
      points.found_again(edge.distance);
      own = edge.covariance[0];
    }
    const bool is_dense = populations.heights().stopped > DENSE, was_broken = is_broken != 0.0;
    is_broken = is_dense && EdgeBreaks::is_sunken(block, found, height);
    blank += smaller(1.0, travel / RAGGED_M) * (found.blank - blank);
    const D before[3] = {edge.distance, scatter, jagged.variance};
    push(scatters, scatter_count, 3, KEPT, before);
    const D more = larger(0.0, square(found.beside) - found.variance - own);
    scatter += smaller(1.0, travel / RAGGED_M) * (more - scatter);
    track.accept(found.beside, found.variance + about);
    const D angle = edge.angle - heading;
    if (!(was_broken || is_broken != 0.0)) jagged.add(wall, middle(block), angle, travel);
    if (is_dense && spacing == 0.0 && __builtin_isfinite(wall.along) && followed >= YOUNG)
      walls.add(edge.distance, edge.angle, wall.along - along);
    smooth(travel, heading);
    turn_away();
    agreed += 0.2 * (1.0 - agreed);
    accepted.is_seen = 1.0, accepted.beside = found.beside, accepted.height = height;
    accepted.angle = angle, accepted.heading = edge.angle;
  }
  void add_point(const Arc& arc, D beside, D variance) {
    D at[2];
    arc.beside(beside, at);
    points.add(at[0], at[1], variance, arc.distance);
  }
  void back_to_scatter(D distance, bool is_wall) {  // before a distance along the edge [m]; is_wall: and its wall
    while (scatter_count > 0.0 && scatters[3 * (int)scatter_count - 3] >= distance) {
      scatter_count -= 1.0;
      const D* row = scatters + 3 * (int)scatter_count;
      scatter = row[1];
      if (is_wall) jagged.variance = row[2];
    }
  }
  void smooth(D travel, D heading) {  // along an edge with bites the track goes on as their outer line
    const Arc& arc = track.arc;
    D deepest = larger(Bites::depth(points, bends, arc), bite * (1.0 - travel / FADING));
    const bool is_known = bite > 0.0 && deepest > SHALLOW;
    const D angle = __builtin_fabs(arc.angle - heading);
    const D deep = larger(DEEP, 0.5 * spacing);  // of rows, whole ones are missing or none
    const bool has_steps = jagged.swing(height) > STEPS * height && spacing == 0.0;
    if (has_steps && angle < PARALLEL && deepest > SLIGHT) deepest = larger(deepest, deep);
    bite = is_known || (deepest >= deep && angle < ALONG) ? deepest : 0.0;
    if (bite > 0.0) turn_sd = Bites::line(points, track.arc, heading);
  }
  void turn_away() {  // where the edge has turned away, what was seen of its begin lies at its wall
    if (bite > 0.0) return walls.clear();
    const D first = walls.move(points, track.arc.angle);
    if (!__builtin_isnan(first)) track.retrace(first, points, noise());
  }
  void bend_away(const Found& found) {  // what seemed bites may be the begin of a bend: from there on the track follows its blocks again
    D since;
    const bool has_bites = bite > 0.0 && lodging.is_lodged == 0.0;
    if (track.has_arc == 0.0 || !breaks.bends_away(found, track.arc.distance, has_bites, since)) return;
    track.retrace(since, points, noise());
    bite = 0.0;
    bends = since;
    jagged.clear();
    back_to_scatter(since, false);
  }
  // The block shows no edge here; where it shows one elsewhere, the last blocks are doubted too.
  void miss(Block& block, D along, bool broke) {
    is_broken = is_broken != 0.0 || broke;
    if (broke) walls.clear();
    if (broke && bite == 0.0) take_back();
    track.advance(along);
    agreed *= 0.8;
    if (!(track.arc.unseen > forget + (breaks.inner.is_seen() ? LONG : 0.0))) return;
    lost = track.arc;
    has_lost = 1.0;
    block.row.lost = 0.0;
    track.clear();
  }
  // Another edge goes on beside a line that broke off: the line is held until that must be the edge.
  void follow_inner(const Found& found, bool is_inside) {
    if (!breaks.follow(found, track, is_inside)) return;
    InnerEdge& inner = breaks.inner;
    D beside, angle;
    if (inner.line(beside, angle)) {
      step_to(inner, beside, angle);
    } else if (inner.is_seen()) {
      points.add(track.arc.x, track.arc.u, square(found.best), track.arc.distance);
    }
  }
  void step_to(InnerEdge& inner, D beside, D angle) {  // the edge stepped into the crop: so far beside the arc [m], at an angle to it [rad]
    const Arc arc = track.arc;
    const D since = inner.row(0)[4];
    points.doubt(since);
    for (int k = 0; k < inner.count; ++k) {
      const D* row = inner.row(k);
      points.add(row[1], row[2], row[3], row[4]);
    }
    points.found_again(since);
    D at[2];
    arc.beside(beside, at);
    Arc on;
    on.begin(at[0], at[1], arc.angle + angle, 0.0, arc.distance);
    track.begin(on);
    is_broken = 0.0;
    breaks.end();
  }
  void take_back() {  // the last blocks were already wrong: what they did to the track and its scatter goes
    if (track.arc.unseen >= 1.0 || scatter_count == 0.0) return;
    D least = scatters[1];
    for (int k = 1; k < scatter_count; ++k) least = smaller(least, scatters[3 * k + 1]);
    BrokenLine line;
    Arc arc = track.arc;
    const D last = line.carry_on(points, arc, least);
    track.rewind(arc, last);
    points.doubt(last + SAME);
    back_to_scatter(last + SAME, true);
  }
  // Lodged crop shows an edge that may lie as far off as its tops: the line goes on, less sure.
  void pass_lodged(const Block& block, const Found& found, D along, D swing) {
    walls.clear();
    if (lodging.lies()) {
      take_back();
      bite = 0.0;
    }
    is_broken = 1.0;
    track.advance(along);
    const D unseen = track.arc.unseen, doubt = square(DOUBT * swing);
    const D top = Lodging::first_metre(block, found.beside, populations);
    if (found.gain >= LEAST_GAIN && __builtin_isfinite(top))  // of flat crop, what stands out is the wall behind it
      track.accept(found.beside, lodging.blocks * doubt + found.variance, false);  // the tops of all lie off alike: together worth one
    points.add(track.arc.x, track.arc.u, doubt, track.arc.distance);
    D sides[4 * CLASSES];
    block.sides(0.0, sides);
    for (int k = 0; k < 4 * CLASSES; ++k) sides[k] *= k / CLASSES % 2 ? 1.0 : FLAT_INSIDE;
    populations.add(sides);
    track.arc.unseen = smaller(unseen, 0.5 * forget);
  }
  // what the next scan and the report of the edge have to know
  void tell(Row& row) const {
    auto& told = row.block;
    told = {};
    told.has_arc = track.has_arc;
    told.height = height;
    if (track.has_arc == 0.0) return;
    const Arc& arc = track.arc;
    const Heights heights = populations.heights();
    told.is_begun = followed >= BEGIN;
    told.x = arc.x, told.u = arc.u, told.angle = arc.angle, told.bend = arc.bend, told.distance = arc.distance;
    told.bite = bite, told.turn_sd = turn_sd, told.agreed = agreed, told.scatter = scatter, told.blank = blank;
    told.crop = heights.crop, told.stubble = heights.stubble, told.stopped = heights.stopped, told.dust = heights.dust;
    told.swing = jagged.swing(height), told.overhang = feet.overhang_of(height);
    told.lean = feet.lean, told.foot = feet.foot, told.cosine = feet.cosine, told.sine = feet.sine;
    told.noise = feet.noise, told.along = spacing != 0.0 ? feet.along(spacing) : 0.0;
    told.points = points.count, told.returns = points.return_count;
    for (int k = 0; k < points.return_count; ++k) row.back[k] = points.returns[k];
  }
};
