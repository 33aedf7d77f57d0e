// How far the feet of the crop stand behind the edge of its canopy: overhang of an upright stand, ramp of one that leans away from the
// edge; and where the rows stand that it was sown in.
//
// The edge of a row crop lies half a spacing out of its last row. Its tops stand over the rows: echoes in the uppermost layers come at
// a period of the spacing, whose phase is where the rows are.
constexpr D FEET_M = 30.0, GUESS = 0.06, MOST = 0.19;  // m of travel; of the crop's height: overhang at first, and at most
constexpr D ROLL = 0.35;                  // slope of a ramp that upright plants feign, per rise across the edge
constexpr D ACROSS = 0.6, SOAKS = 0.03;   // the same per rad at which rays go into the crop, from so many on: they soak in
constexpr D TOPS = 0.9, ROWS_M = 8.0;     // of the crop's height, from which on echoes are of tops; m along which rows go alike

struct Accepted : AcceptedRow {};  // a block whose edge was followed: beside the frame [m], height of the crop [m], angles of the
                                  // edge to the machine and at rest [rad]

// lean: as the ramp says; cosine, sine, noise: of the uppermost layers over the rows: sums of cosines and sines of places; of the squares
// of what each block added to them; rows: heading of the rows, at rest, turned: the edge to them [rad]; since: travel since the overhang
// was fitted, overhang: what it came to [m], nan = never; seen, heights: what it is fitted to, see canopy_offset.py
struct CanopyFeet : CanopyFeetRow {
  static D guess(D height) { return GUESS * larger(height, 0.0) + 0.0; }
  D overhang_of(D height) const {  // learned overhang of an upright canopy [m]
    const D most = ramp.is_known() ? MOST : USUAL;
    return smaller(__builtin_isfinite(overhang) ? overhang : guess(height), most * height);
  }
  D along(D spacing) const {  // how sure the edge goes along the rows, which run straight, 0..1
    return 1.0 - smaller(__builtin_fabs(turned) * ROWS_M / spacing, 1.0);
  }
  void move(D travel) {  // old counts of the overhang fade over a travel [m]
    if (!(travel > 0.0)) return;
    const D keep = ::exp(-travel / FEET_M);
    for (D& count : seen) count *= keep;
    for (D& count : heights) count *= keep;
    since += travel;
  }
  // Rows run straight: an edge that turned away from them goes across, and its plants agree by that.
  void look_for_rows(const D* counts, D edge, D travel, D height, D heading, D spacing) {
    if (spacing == 0.0) return;
    rows = noise > 0.0 ? rows : heading;
    turned = heading - rows;
    rows += along(spacing) * travel / FEET_M * turned;
    const int cells = whole_of(spacing * (int)(WINDOW / spacing) / CELL);
    const int first = whole_of((edge + HALF) / CELL), layer = whole_of((TOPS * height - LOWEST) / LAYER);
    D c = 0.0, s = 0.0;
    for (int i = first; i < first + cells && i < PLACES; ++i) {
      const D tops = sum(counts + CLASSES * i + layer, layer < LAYERS ? LAYERS - layer : 0);
      const D phase = 2.0 * PI * (CELL * (i + 0.5) - HALF) / spacing;
      c += tops * ::cos(phase);
      s += tops * ::sin(phase);
    }
    const D turn = 2.0 * PI * edge / spacing, keep = ::exp(-travel / ROWS_M);
    cosine = keep * cosine + (::cos(turn) * c + ::sin(turn) * s);
    sine = keep * sine + (::cos(turn) * s - ::sin(turn) * c);
    noise = square(keep) * noise + c * c + s * s;
  }
  // A block that was accepted, once its rays were counted for the overhang. found: what that was fitted to, nan = it was not
  void learn(const Block& block, const Accepted& accepted, D spacing, D found) {
    const D travel = block.row.travel, height = accepted.height;
    if (__builtin_isfinite(found)) {
      since = 0.0;
      overhang = found;
    }
    ramp.move(travel);
    look_for_rows(block.counts, accepted.beside, travel, height, accepted.heading, spacing);
    if (__builtin_fabs(accepted.angle) < OBLIQUE) ramp.add(block.counts, accepted.beside);
    const D feigned = ROLL * __builtin_fabs(block.row.rise) + ACROSS * larger(block.row.across - SOAKS, 0.0);
    const D alike = larger(1.0, (block.row.next - block.row.first) * ALIKE_M / larger(travel, ALIKE_M));
    const Ramp found_ramp = ramp.foot(height, overhang_of(height), alike, feigned);
    lean = found_ramp.share, foot = found_ramp.foot, slope = found_ramp.slope;
  }
};
