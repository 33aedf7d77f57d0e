// The edge just ahead of the knife as the detector tells it, after overhang.cpp and near.cpp: the body of a native function.
//
// The line that near.cpp fits lies at the canopy; it is moved to the feet of the crop: behind the overhang of an upright stand,
// or to the foot of the ramp of one that leans away from the edge, and then to where the stand's height, what the header cuts
// and other scanners say that they are. Stage FEET finds what has to be known of the first two, stage EDGE the rest.
//
// In: points of the edge. In and out: a row of detector_rows.py. Out: edge, a row of `CropEdge`.

// Bites and swing: of the scatter beyond that of an even edge, which is so much of the crop's height. Of what the wall lies to
// and fro along the edge: bites behind what stands out. Of the depth of bites: the edge lies 0.76 of it further in than the
// line, at most. Of the spacing of rows: scatter of single plants, which are no bites.
constexpr D RAGGED = 2.8, EVEN = 0.03, HIDDEN = 0.4, BITES = 0.8, ROWS = 0.125;
// m per bend of 1/m: rays that cross the edge show it less well. m per rad that the edge turns away from the crop: 1.3 % of
// wheel slip, not known.
constexpr D BENT = 0.4, SLIPPED = 0.12;
// m: least deviation of an edge that is held, not seen; from so far to the nearest block on it is held; travel over which the
// header tells its width. Least cosine of the edge's angle to the machine.
constexpr D HELD = 0.167, BETWEEN = 0.7, OVER_M = 1.0, LEAST_COS = 0.2;
// shares of rays that dust takes: it hides nothing, all; m of spread of the blocks: on an uneven edge the usual overhang counts
constexpr D CLEAR = 0.05, DUSTY = 0.12, SMOOTH_M = 0.05, UNEVEN_M = 0.09;
// of the spacing of rows: by how much they seem nearer where they are seen from the side; a third of it from above. Standard
// deviation of the overhang of an upright canopy, of itself.
constexpr D FLANKS = 0.15, FEET_SD = 0.25;

struct Edge {
  D offset, heading, curvature, reference_x, confidence, crop_height, stubble_height, offset_sd, heading_sd, seen_to;
  bool is_held;
  D other_offset, other_chance;
};
Edge& reported = *(Edge*)edge.data;
auto& line = q.line;
const int count = (int)b.points;
auto distance = [&](int i) { return points.data[i][3]; };
auto is_seen = [&](int i) { return points.data[i][2] < VAGUE * VAGUE; };
auto shows = [&](D place, D early) {  // a standing edge was seen near a place along it, and no hole may lie there
  bool found = false;
  for (int i = 0; i < count; ++i) found |= __builtin_fabs(distance(i) - place) <= BETWEEN && is_seen(i);
  for (int i = 0; i < (int)b.returns; ++i) found &= !(place - early < q.back[i] && q.back[i] < place + BETWEEN);
  return found;
};
auto along = [&] { return distance(count - 1) - line.seen_to; };  // the edge, of the reported place [m]
auto canopy = [&](D x, D steep) {  // where its edge lies aside at a place ahead of the machine's origin [m]; steep: its cosine
  const D beyond = x - line.x;
  return line.u + beyond * ::tan(line.angle) + 0.5 * line.bend * square(beyond / steep) / steep;
};

constexpr D OLD = 0.15, LATE = 0.4;  // s: age of the newest scan from which on an edge is less sure, and is none
const D age = (s.now - s.scan_t) / 1e9;
const Frame here = moved(d, s, age);

if (stage & FEET) f.is_found = b.is_begun > 0.0 && age <= LATE && b.points >= 2.0;
if (stage & FEET && f.is_found > 0.0) {
  const D cosine = ::cos(here.angle), sine = ::sin(here.angle), dx = b.x - here.x, du = b.u - here.u;
  const Frame front{cosine * dx + sine * du, cosine * du - sine * dx, b.angle - here.angle};
  fit_near(here, front);
  bool goes_on = false;
  for (int i = 0; i < count; ++i) goes_on |= distance(i) >= along() - BETWEEN && is_seen(i);
  if (!(b.bite == 0.0 && goes_on)) {  // as the track has it
    const D more = d.reference - front.x, way = more / larger(::cos(front.angle), LEAST_COS);
    const D u = front.u + more * ::tan(front.angle) + 0.5 * b.bend * square(way);
    line = {d.reference, u, front.angle + b.bend * way, b.bend, larger(line.offset_sd, BITES * b.bite),
            larger(line.angle_sd, b.turn_sd), line.gap, line.spread, line.seen_to};
  }
  // all that was seen of the edge may lie ahead of the reported place: what is ahead will be reached
  f.is_found = !(line.gap > d.hold && !(line.seen_to > distance(count - 1) - distance(0)));

  // how clearly rows are seen 0..1, half a spacing out of the one nearest to a place [m], its deviation [m]: blocks that see
  // none point anywhere, the square of their sum is that of each, summed, and exceeds it by a factor f with the chance exp(-f)
  auto row_at = [&](D beside) {
    if (!(b.noise > 0.0)) return Mode{0.0, 0.0, 0.0};
    const D times = (b.cosine * b.cosine + b.sine * b.sine) / b.noise, turn = 2.0 * PI;
    const D first = d.spacing * (::atan2(b.sine, b.cosine) / turn - 0.5);
    const D place = first + d.spacing * __builtin_rint((beside - first) / d.spacing);
    const D clear = b.along * (1.0 - ::exp(-larger(times - 1.0, 0.0)));
    return Mode{clear, place, d.spacing / (turn * __builtin_sqrt(2.0 * larger(times, 1.0)))};
  };
  auto mixed = [&](D share, const Mode& one, const Mode& other) {  // two that may hold, the first with a chance `share`
    const D rest = 1.0 - share, apart = share * rest * square(one.place - other.place);
    const D all = share * square(one.sd) + rest * square(other.sd) + apart;
    return Mode{1.0, share * one.place + rest * other.place, __builtin_sqrt(all)};
  };
  const D crop = b.crop + q.ground.plane;
  Mode upright{0.0, 0.0, 0.0}, ramp{0.0, 0.0, 0.0};
  if (b.height > 0.0) {
    const D clean = within(0.0, (DUSTY - b.dust) / (DUSTY - CLEAR), 1.0);
    const D dense = larger(density(b.stopped), 1.0 - clean);  // in dust it is not seen how dense the crop is
    const D even = within(0.0, (UNEVEN_M - line.spread) / (UNEVEN_M - SMOOTH_M), 1.0);
    const D learned = dense * b.overhang, usual = dense * USUAL * b.height;
    upright = mixed(clean * even, {1.0, learned, FEET_SD * learned}, {1.0, usual, 0.5 * usual});
    Mode row = row_at(upright.place);
    row.sd = length(row.sd, FLANKS * larger(d.spacing - larger(d.view - crop, 0.0), d.spacing / 3.0));
    upright.sd = length(upright.sd, d.spacing / EVENLY);
    upright = mixed(row.chance, row, upright);
    ramp = {(1.0 - row.chance) * b.lean, clean * b.foot - upright.place, FEET_SD * __builtin_fabs(b.foot)};
  }
  // of plants, which stand out by themselves; where all plants are
  const D rows = row_at(upright.place).chance, dense = larger(b.stopped, rows);
  const D low = stage == FEET ? lean_of(crop, dense) : 0.0;
  f = {f.is_found, upright.place, upright.sd, ramp.chance, ramp.place, ramp.sd, rows, dense, low, f.hang_sd};
}

if (stage & EDGE) {
  const D none = __builtin_nan("");
  reported = {none, none, 0.0, d.reference, 0.0, none, none, none, none, none, false, none, 0.0};
  if (f.is_found > 0.0) {
    const D steep = larger(::cos(line.angle), LEAST_COS), knife = along() + (d.knife - line.x);
    const D crop = b.crop + q.ground.plane, place = canopy(d.reference, steep);
    if (s.missing < HOLES_M && shows(knife, OVER_M)) {
      const D keep = ::exp(-s.travel / CUT_M);
      s.cut_way = keep * s.cut_way + s.travel;
      s.cut_missing = keep * s.cut_missing + s.travel * s.missing;
      s.cut_beside = keep * s.cut_beside + s.travel * (canopy(d.knife, steep) + f.shift / steep - d.centre);
    }
    fill(crop, q.ground.plane_sd, f.dense, {f.ramp_chance, f.ramp, f.ramp_sd});
    const D all = sum(hangs, PLACES);
    int inside = 0;  // places
    for (int k = 0; k < PLACES; ++k) hangs[k] /= all, inside += !(place_of(k) > TOLERANCE);
    Mode out = mode_of(inside, PLACES - inside), in = mode_of(0, inside);  // leaning out by more than that, and not
    const bool stands = out.chance < in.chance || (out.chance == in.chance && out.place < in.place);
    const Mode &other = stands ? out : in, &likely = stands ? in : out;
    for (int k = 0; k < PLACES; ++k) part[k] = hangs[k] * ((place_of(k) - likely.place) * (place_of(k) - likely.place));
    f.hang_sd = __builtin_sqrt(sum(part, PLACES));

    const bool is_smooth = b.bite > 0.0;
    const D even = larger(EVEN * b.height, ROWS * f.rows * d.spacing);
    const D ragged = is_smooth ? 0.0 : __builtin_sqrt(larger(0.0, b.scatter - square(even)));
    const D hidden = HIDDEN * density(b.stopped) * (1.0 - f.rows) * (is_smooth ? 0.0 : b.swing);
    const D alike = d.open + density(b.stopped) * (d.closed - d.open);
    D known = length(line.offset_sd, RAGGED * ragged, hidden, f.shift_sd);
    known = length(known, BENT * line.bend, SLIPPED * smaller(line.angle, 0.0), alike);
    known = length(known, b.blank / EVENLY);  // evenly anywhere in it
    D sd = length(known, f.hang_sd) / steep, sure = 0.0;
    const D scale = 1.0 / (__builtin_sqrt(2.0) * known);  // feet within TOLERANCE of where they are told
    for (int k = 0; k < PLACES; ++k) {
      const D away = place_of(k) - likely.place;
      if (hangs[k] > NEVER) sure += 0.5 * hangs[k] * (::erf((TOLERANCE - away) * scale) + ::erf((TOLERANCE + away) * scale));
    }
    sure = sure * smaller(1.0, b.agreed / 0.8);
    // the wall behind a hole is seen from over it: rays on their way down from the canopy's top to the lower limit are stopped
    // by it; a block lies in the middle of that way
    if (is_smooth || !__builtin_isfinite(crop) || !shows(along(), d.early * crop + 0.5 * BLOCK))
      sure = smaller(sure, UNSURE), sd = larger(sd, HELD);
    sure = smaller(larger(sure, LEAST_SURE), 1.0);
    auto aside = [&](const Mode& m) { return d.sign * (place + (f.shift + m.place) / steep); };
    const D share = smaller((LATE - age) / (LATE - OLD), 1.0), aged = share >= 1.0 ? sure : larger(share * sure, LEAST_SURE);
    const D ends = d.reference + (line.seen_to + 0.5 * BLOCK) * steep, aside_too = other.chance > 0.0 ? aside(other) : none;
    reported = {aside(likely), d.sign * line.angle, d.sign * line.bend, d.reference, aged, crop, b.stubble + q.ground.plane, sd,
                line.angle_sd, ends, line.gap > 1.0, aside_too, other.chance};
  }
}
