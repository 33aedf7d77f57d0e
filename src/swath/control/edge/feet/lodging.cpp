// Crop that has become lower than before: lodged, its tops lie off, and its edge says little of its feet.
constexpr D STANDS = 0.3, LOW_SHARE = 0.94, LOW_STEP = 0.03;  // [1], [1], m: of its height over the stubble; lower than this is lodged
constexpr D MAT_M = 0.3;  // m inside the track: there crop that lies flat is looked for
constexpr D DENSE = 0.8;  // share of the rays that crop stops, from which on its height is known
constexpr D OBLIQUE = 0.09;  // rad to the edge from which on its wall looks like a ramp

// Compares the first metre of crop with itself before. is_lodged: the last block was; blocks: of the patch so far; stubble: height of
// its plane over the ground [m]; usual: height of the first metre of crop over the plane [m]
struct Lodging : LodgingRow {
  static void just_inside(const Block& block, D edge, D* into) {
    block.between(block.counts, edge + 0.1, edge + 1.1, into);
  }
  // height of the first metre of crop behind an edge over the plane [m], nan where it is no canopy
  static D first_metre(const Block& block, D edge, const Populations& populations) {
    D counts[CLASSES];
    just_inside(block, edge, counts);
    return populations.height_of(counts);
  }
  void stands(const Block& block, D edge, const Populations& populations) {  // crop stands behind an edge [m] of a block
    is_lodged = 0.0;
    const D now = first_metre(block, edge, populations);
    if (__builtin_isfinite(now)) usual = __builtin_isnan(usual) ? now : usual + 0.1 * (now - usual);
  }
  bool lies() {  // one more block of a patch that lies; whether it is its first
    const bool is_first = is_lodged == 0.0;
    blocks = is_first ? 1.0 : blocks + 1.0;
    is_lodged = 1.0;
    return is_first;
  }
  // How far the tops of a stand that has become low may have moved aside [m], 0 where it stands. Stems of length h whose tops are at z
  // lean by acos(z / h), their tops lie h sin(lean) beside the feet. edge: of the block [m]; angle: of the track to the machine [rad]
  D swing(const Block& block, D edge, const Populations& populations, D angle) const {
    const D tall = usual + stubble;
    const bool is_doubtful = (populations.heights().stopped < DENSE && is_lodged == 0.0) || !(usual > STANDS * tall);
    if (is_doubtful || __builtin_fabs(angle) > 3.0 * OBLIQUE) return 0.0;
    D now = stubble + first_metre(block, edge, populations), mat[CLASSES];
    just_inside(block, MAT_M, mat);
    if (__builtin_isnan(now) && populations.has_mat(mat)) now = stubble + LIMIT * usual;
    if (!(now < LOW_SHARE * tall - LOW_STEP)) return 0.0;
    return __builtin_sqrt(square(tall) - square(now));
  }
};
