// A block: the rays of some decimetres of travel, counted by place beside the expected edge and by class.
//
// Many rays together show an edge that no single scan shows: at 30 stems/m2 one ray in six is stopped.
constexpr D WINDOW = 2.5;      // m to either side of the expected edge whose rays count for a known edge
constexpr D ALIKE_M = 0.24;    // m of travel from one look at the stand to another that is independent of it
constexpr D NONE = 1e-12, FEWEST_RAYS = 30.0;  // in the place of no counts; rays to either side of an edge
constexpr D FINEST = 0.015;    // m, standard deviation that no block falls below
constexpr int ABOUT = 10;      // places of CELL to either side over which the dust of one is taken, own choice
constexpr D CLEAR = 0.35;      // m beside the edge from which on a ray belongs to one side
constexpr int FROM = 60, WITHIN = 200;  // places within WINDOW: the first one, their number
// while nothing is known four places count as one, and layers: the stubble, whose plane is not known well, then pairs
constexpr int COARSE = PLACES / 4, KINDS = 23;

// The edge of a block. beside [m] of the frame, variance [m2]; gain [nat] over "all crop" and "no crop"; lead [nat]: of the best
// place anywhere, `best` [m], over the best one within the gate; blank: width of the strip about the edge in which no ray says
// anything [m]
struct Found {
  D beside, variance, gain, lead, blank, best;
};

struct Parted {  // where two unknown populations part best: place [m], gain [nat], counts of crop and stubble
  D place, gain, crop[CLASSES], stubble[CLASSES];
};

struct Block {
  decltype(Row::counted)& row;
  D *counts, *solid;  // of rays, of those that were there a scan before (PLACES, CLASSES)
  Answer* answers;

  void clear() {  // no rays
    const D lost = row.lost;
    row = {};
    row.lost = lost;
    for (int k = 0; k < PLACES * CLASSES; ++k) counts[k] = solid[k] = 0.0;
  }
  void fade(D share) {  // all that it holds counts that much; what the rays of its first scan say is left out
    for (int k = 0; k < PLACES * CLASSES; ++k) counts[k] *= share, solid[k] *= share;
    row.travel *= share, row.along *= share, row.near *= share, row.scans *= share;
    int kept = 0;
    for (int k = 0; k < row.rays; ++k)
      if (answers[k].scan > row.first) answers[kept++] = answers[k];
    row.rays = kept;
    row.first += 1.0;
  }
  D along() const { return row.near != 0.0 ? row.along / row.near : NO_NUMBER; }  // mean place of its rays along the frame [m]
  D alike() const {  // rays per independent ray: successive scans see the same stems
    return larger(1.0, row.scans / larger(1.0, row.travel / ALIKE_M));
  }
  static D place(int k) { return -HALF + CELL * k; }  // where a place begins [m]
  static int place_of(D beside) { return (int)within(0.0, __builtin_rint((beside + HALF) / CELL), PLACES); }
  __attribute__((noinline)) static void add_places(const D* some, int first, int last, D* into) {  // of each class over places
    for (int k = 0; k < CLASSES; ++k) into[k] = 0.0;
    for (int i = first; i < last; ++i)
      for (int k = 0; k < CLASSES; ++k) into[k] += some[CLASSES * i + k];
  }
  static void between(const D* some, D low, D high, D* into) { add_places(some, place_of(low), place_of(high), into); }
  // counts well inside the crop and beside it, then the solid ones of both; edge [m]
  void sides(D edge, D* into) const {
    between(counts, edge + CLEAR, edge + WINDOW, into);
    between(counts, edge - WINDOW, edge - CLEAR, into + CLASSES);
    between(solid, edge + CLEAR, edge + WINDOW, into + 2 * CLASSES);
    between(solid, edge - WINDOW, edge - CLEAR, into + 3 * CLASSES);
  }
  // Optical depth of the dust above the crop about each place, by the share of the rays that it answered there; whether there is
  // any.
  __attribute__((noinline)) bool haze(D* into) const {
    constexpr int WIDE = 2 * ABOUT + 1;
    bool is_dusty = false;
    for (int i = 0; i < PLACES; ++i) is_dusty |= counts[CLASSES * i + DUST] != 0.0;
    D rays[PLACES + WIDE], met[PLACES + WIDE];
    for (int i = 0; is_dusty && i < PLACES + WIDE; ++i) {
      const int place = i - ABOUT - 1;
      const bool is_one = place >= 0 && place < PLACES;
      rays[i] = (i ? rays[i - 1] : 0.0) + (is_one ? sum(counts + CLASSES * place, CLASSES) : 0.0);
      met[i] = (i ? met[i - 1] : 0.0) + (is_one ? counts[CLASSES * place + DUST] : 0.0);
    }
    for (int i = 0; i < PLACES; ++i) {
      const D of = is_dusty ? rays[i + WIDE] - rays[i] : 0.0, dust = is_dusty ? met[i + WIDE] - met[i] : 0.0;
      into[i] = ::log((of + 1.0) / (of - dust + 1.0));
    }
    return is_dusty;
  }
  __attribute__((noinline)) D blank(D edge) const {  // width of the strip about an edge in which no count is but of dust [m]
    D last = -HALF;
    for (int i = 0; i < PLACES; ++i) {
      bool is_filled = false;
      for (int k = 0; k < CLASSES; ++k) is_filled |= k != DUST && counts[CLASSES * i + k] != 0.0;
      if (is_filled && place(i) >= edge) return larger(place(i) - last, 0.0);
      if (is_filled) last = place(i) + CELL;
    }
    return larger(HALF - last, 0.0);
  }
  // Mean [m] and variance [m2] of places by their chances, which come to add up to one.
  static void weigh(const D* places, D* chance, int n, D& mean, D& variance) {
    const D all = sum(chance, n);
    for (int i = 0; i < n; ++i) chance[i] /= all;
    mean = sum_of(n, [&](int i) { return chance[i] * places[i]; });
    variance = sum_of(n, [&](int i) { return chance[i] * ((places[i] - mean) * (places[i] - mean)); });
  }
  // Mean [m] and variance [m2] of the normal that takes one about 0 of the variance `known` to the mean and the variance of its
  // product with the chances of places. It lies among these: of chances that rise to one side all the way no normal is like them.
  __attribute__((noinline)) static void added(const D* places, const D* chance, int n, D known, D& mean, D& variance) {
    D both[WITHIN + 1];
    for (int i = 0; i < n; ++i) both[i] = chance[i] * ::exp(-0.5 * (places[i] * places[i]) / known);
    D middle, own;
    weigh(places, both, n, middle, own);
    own = larger(own, CELL * CELL / 12.0);  // of one place
    const D more = 1.0 / own - 1.0 / known;
    mean = more > 1e-3 ? within(places[0], middle / (own * more), places[n - 1]) : 0.0;
    variance = more > 1e-3 ? 1.0 / more : 1e3;
  }
  // The edge within +-`gate` [m] of the frame: its mean and variance under the likelihood of all places.
  //
  // worth: of the rays of each place within WINDOW [nat]; known: variance [m2] with which the edge is known to lie on the frame: mean
  // and variance are then what the block adds to that. Where dust hides one side it only says on which side the edge is not.
  __attribute__((noinline)) Found find_edge(const D* worth, D gate, D known) const {
    D gain[WITHIN + 1], places[WITHIN + 1], chance[WITHIN + 1], mean, variance;
    const D alike_rays = alike();
    gain[WITHIN] = 0.0;
    for (int i = WITHIN - 1; i >= 0; --i)
      gain[i] = i == WITHIN - 1 ? worth[i] / alike_rays : gain[i + 1] + worth[i] / alike_rays;
    const D base = larger(gain[0], 0.0);
    int n = 0, first = -1, top = 0;
    D best = -INFINITE;
    for (int i = 0; i <= WITHIN; ++i) {
      gain[i] -= base;
      if (gain[i] > gain[top]) top = i;
      if (!(__builtin_fabs(place(FROM + i)) <= gate)) continue;
      if (first < 0) first = i;
      places[n++] = place(FROM + i);
      best = larger(best, gain[i]);
    }
    for (int i = 0; i < n; ++i) chance[i] = ::exp(gain[first + i] - best);
    weigh(places, chance, n, mean, variance);
    if (known < INFINITE) added(places, chance, n, known, mean, variance);
    return Found{mean, variance + FINEST * FINEST, best, gain[top] - best, blank(mean), place(FROM + top)};
  }
  static D entropy(const D* some) {  // log-likelihood [nat] of counts under their own shares
    const D total = larger(sum(some, KINDS), NONE);
    return sum_of(KINDS, [&](int k) { return some[k] * ::log(larger(some[k], NONE) / total); });
  }
  // Where two unknown populations part best: every place is tried as the edge, each side with its own shares of the classes; the
  // gain is that of two populations over one, less what chance gives, and a normal prior of `spread` [m] about the frame.
  __attribute__((noinline)) void split(D spread, Parted& found) const {
    D below[COARSE][KINDS], above[KINDS];
    for (int i = 0; i < COARSE; ++i) {
      D four[CLASSES];
      add_places(counts, 4 * i, 4 * i + 4, four);
      for (int kind = 0, k = 0; kind < KINDS; ++kind) {
        const D first = four[k++];
        const int end = kind == 0 ? 8 : k < LAYERS ? k + 1 : k;
        D more = 0.0;
        for (; k < end; ++k) more += four[k];
        below[i][kind] = (i ? below[i - 1][kind] : 0.0) + (first + more);
      }
    }
    const D* total = below[COARSE - 1];
    const D one = entropy(total), alike_rays = alike();
    int kinds = 0, best = 0;
    for (int kind = 0; kind < KINDS; ++kind) kinds += total[kind] != 0.0;
    D most = 0.0;
    for (int i = 0; i < COARSE - 1; ++i) {
      for (int kind = 0; kind < KINDS; ++kind) above[kind] = total[kind] - below[i][kind];
      D gain = (entropy(below[i]) + entropy(above) - one) / alike_rays - kinds;
      if (sum(below[i], KINDS) < FEWEST_RAYS || sum(above, KINDS) < FEWEST_RAYS) gain = -INFINITE;
      const D away = place(4 * (i + 1)) / spread, weighed = gain - 0.5 * (away * away);
      if (i == 0 || weighed > most) most = weighed, best = i;
    }
    found.place = place(4 * (best + 1));
    found.gain = most;
    const int first = whole_of((found.place + HALF) / CELL);
    add_places(counts, first, PLACES, found.crop);
    add_places(counts, 0, first, found.stubble);
  }
};
