// A stand that leans into itself, away from the edge, shows a ramp: its canopy begins at the feet and rises.
//
// The higher the layer, the further in it begins: at height z the outermost stems have come z tan(lean) inward. Where each layer begins
// is fitted by a line over its height; the line's zero is the row of feet. A stand that leans out shows nothing of the kind: its wall
// is as sharp as that of an upright one, only further out.
//
// An upright canopy rises a little, too: its top is sparse. The further it hangs over the edge, the less, so that the slope says more
// together with the overhang: leaning inward makes both larger.
constexpr D RAMP_HALF = 1.2, RAMP_M = 6.0;  // m to either side of the edge that are kept, in RAMP_PLACES; m of travel
constexpr int LEVELS = 5;                         // heights at which the begin of the canopy is looked for
constexpr int WALL_FIRST = 32, WALL_PLACES = 40;  // it is looked for in places of a metre about the edge,
constexpr D WALL_FROM = -0.4, BEHIND_EDGE = 0.6;  // from so far beside it on [m]; m behind it: the stand within
constexpr D ENOUGH_COUNTS = 400.0, FEWEST_LAYERS = 2.0;  // layers between the lowest and the highest level: fewer show no ramp
constexpr D WHOLE = 0.75;  // of the share that is stopped within: there the canopy has begun
constexpr D SOAK = 0.035;  // m per slope by which it seems to begin late
constexpr D STEEP = 0.085, FLATTER = 0.6;  // slope of an upright canopy without overhang; less this times that per height
constexpr D SURE = 2.0, WIDTH = 0.07;  // standard deviations beyond that from which on it may be a ramp; slope further until it is one
constexpr D LOW = 0.3;                 // slope that a low crop feigns, among whose lower layers is stubble
constexpr D LOW_TO = 0.55, TALL_FROM = 0.75;  // m: it is low below the first, no longer from the second on
constexpr D PI = 3.141592653589793;

struct Ramp {  // share 0..1 of it being one, the feet beside the edge [m], tangent of the lean
  D share, foot, slope;
};

struct LeanRamp : LeanRampRow {  // counts of answers by place beside the edge and by layer
  bool is_known() const { return sum(counts, RAMP_PLACES * LAYERS) >= ENOUGH_COUNTS; }  // enough to see whether there is a ramp
  void move(D travel) {  // old counts fade over a travel [m]
    const D keep = ::exp(-travel / RAMP_M);
    for (D& count : counts) count *= keep;
  }
  void add(const D* seen, D edge) {  // a block's counts (PLACES, CLASSES) with its edge [m]
    const int first = PLACES / 2 + whole_of(edge / CELL) - RAMP_PLACES / 2;
    if (first < 0 || first + RAMP_PLACES > PLACES) return;
    for (int i = 0; i < RAMP_PLACES; ++i)
      for (int k = 0; k < LAYERS; ++k) counts[LAYERS * i + k] += seen[CLASSES * (first + i) + k];
  }
  struct Open {  // by place of the wall and level: share 0..1 of the canopy that is not there yet; by place: rays that show it
    D missing[WALL_PLACES][LEVELS], rays[WALL_PLACES];
  };
  // stopped: rays above each level, of all rays; whole: share that is stopped where it is there. A place without rays is as the nearest
  // one with some.
  static void open(const D (*stopped)[LEVELS], const D* rays, const D* whole, Open& found) {
    D seen[WALL_PLACES], order[WALL_PLACES];
    int n = 0, nearest[WALL_PLACES], shared[WALL_PLACES] = {};
    for (int i = 0; i < WALL_PLACES; ++i)
      if (rays[i] > 0.0) order[n] = n, seen[n++] = i;
    for (int i = 0; n && i < WALL_PLACES; ++i) ++shared[nearest[i] = whole_of(Np::interp(i, seen, order, n))];
    for (int i = 0; i < WALL_PLACES; ++i) {
      const int at = n ? (int)seen[nearest[i]] : i;
      found.rays[i] = n ? rays[at] / shared[nearest[i]] : 1.0;
      for (int k = 0; k < LEVELS; ++k)
        found.missing[i][k] = n ? 1.0 - smaller(stopped[at][k] / (rays[at] * larger(whole[k], 1e-3)), 1.0) : 0.0;
    }
  }
  static D by_chance(D rays, D most) {  // what seems missing in the mean where all is there: more than all does not count
    const D sd = __builtin_sqrt(larger(1.0 - most, 0.0) / (most * rays)) / WHOLE;
    const D away = (1.0 / WHOLE - 1.0) / larger(sd, 1e-3);
    return sd * (::exp(-0.5 * away * away) / __builtin_sqrt(2.0 * PI) - away * (0.5 * ::erfc(__builtin_sqrt(0.5) * away)));
  }
  // Standard deviation that chance gives the slope, of rays that are each stopped in one layer. lever: weight of the begin of each level
  // in the slope
  static D slope_sd(const Open& seen, const D* lever, const D* whole) {
    const D all = sum_of(WALL_PLACES, [&](int i) {
      D above[LEVELS + 1] = {}, worth = 0.0, mean = 0.0, squares = 0.0;
      for (int k = 0; k < LEVELS; ++k)
        above[k] = seen.missing[i][k] > 0.0 ? (1.0 - seen.missing[i][k]) * whole[k] : whole[k];
      for (int k = 0; k < LEVELS; ++k) {
        const D stopped = larger(above[k] - above[k + 1], 0.0);
        worth += seen.missing[i][k] > 0.0 ? lever[k] / whole[k] : 0.0;  // of a ray that such a layer stops
        mean += stopped * worth;
        squares += stopped * (worth * worth);
      }
      return (squares - mean * mean) / seen.rays[i];
    });
    return CELL * __builtin_sqrt(all);
  }
  // height [m] of the crop; overhang [m] that an upright one would have; alike: rays per independent ray; feigned: slope that the view
  // may feign
  __attribute__((noinline)) Ramp foot(D height, D overhang, D alike, D feigned) const {
    const Ramp none = {0.0, 0.0, 0.0};
    constexpr D SHARES[LEVELS] = {0.3, 0.4, 0.5, 0.6, 0.7};
    if (!((SHARES[LEVELS - 1] - SHARES[0]) * height > FEWEST_LAYERS * LAYER) || !is_known()) return none;
    int layer[LEVELS];
    for (int k = 0; k < LEVELS; ++k) layer[k] = (int)within(1.0, __builtin_rint((SHARES[k] * height - LOWEST) / LAYER), LAYERS - 1.0);
    D stopped[RAMP_PLACES][LEVELS], rays[RAMP_PLACES], inside[RAMP_PLACES];
    D most[LEVELS] = {}, whole[LEVELS];
    int n = 0;
    for (int i = 0; i < RAMP_PLACES; ++i) {
      D above[LAYERS];
      for (int k = LAYERS - 1; k >= 0; --k) above[k] = (k < LAYERS - 1 ? above[k + 1] : 0.0) + counts[LAYERS * i + k];
      for (int k = 0; k < LEVELS; ++k) stopped[i][k] = above[layer[k]];
      rays[i] = above[0];
      if (!(CELL * (i + 0.5) - RAMP_HALF > BEHIND_EDGE)) continue;
      inside[n++] = rays[i];
      for (int k = 0; k < LEVELS; ++k) most[k] += stopped[i][k];
    }
    const D all_rays = larger(sum(inside, n), 1.0);
    bool is_stopped = true;
    for (int k = 0; k < LEVELS; ++k) most[k] /= all_rays, whole[k] = WHOLE * most[k], is_stopped &= most[k] != 0.0;
    if (most[1] < 0.5 || !is_stopped) return none;
    Open seen;
    open(stopped + WALL_FIRST, rays + WALL_FIRST, whole, seen);
    D begins[LEVELS] = {};
    for (int i = 0; i < WALL_PLACES; ++i) {
      seen.rays[i] /= alike;
      for (int k = 0; k < LEVELS; ++k) {
        D& missing = seen.missing[i][k];
        missing -= (1.0 - missing) * by_chance(seen.rays[i], most[k]);
        begins[k] += missing;
      }
    }
    for (D& begin : begins) begin = WALL_FROM + CELL * begin;
    auto level = [&](int k) { return LOWEST + LAYER * layer[k]; };
    const D middle = sum_of(LEVELS, level) / LEVELS;
    const D all = sum_of(LEVELS, [&](int k) { return (level(k) - middle) * (level(k) - middle); });
    D lever[LEVELS];
    for (int k = 0; k < LEVELS; ++k) lever[k] = (level(k) - middle) / all;
    const D slope = sum_of(LEVELS, [&](int k) { return lever[k] * begins[k]; });
    const D place = mean_of(begins, LEVELS) - slope * (middle + SOAK);
    const D upright = larger(STEEP - FLATTER * overhang / height, 0.0);
    const D low = within(0.0, (TALL_FROM - height) / (TALL_FROM - LOW_TO), 1.0);
    const D chance = SURE * slope_sd(seen, lever, whole);
    const D share = within(0.0, (slope - upright - feigned - LOW * low - chance) / WIDTH, 1.0);
    return Ramp{share, within(-0.5, place, 0.2), slope};
  }
};
