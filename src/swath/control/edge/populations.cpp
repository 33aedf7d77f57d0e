// What rays answer in the crop and beside it, learned while driving, and what one more answer is worth.
//
// The class of an answer is a layer of height above the stubble side, dust, no echo, or an echo of the air at the scanner: nothing
// behind it answered louder. Counts of the classes on either side of the edges accepted so far give the log-likelihood ratio of
// every class. Nothing is assumed about crop, stubble, density or dust: where puffs swallow the beams on one side only, "no echo"
// itself is evidence.
constexpr D MEMORY = 15.0, SHORT = 2.0;     // m of travel after which counts are worth 1/e; the same of what has just changed
constexpr D FRESH = 0.25, STRANGE = 0.15;   // share of the short memory, and of anything above the stubble, in the crop
constexpr D STRAY = 0.03, MOST_WORTH = 3.0;  // share of answers beside the crop that are something else: weeds; nat of a ray at most
constexpr D CROP_FROM = 0.18, LOW_CROP_TO = 1.15, CROP_TO = 2.5;  // m above the stubble: heights of crop that was not seen yet
constexpr D STUBBLE_TO = 0.8, LITTLE = 0.12;  // m; part of the fullest layer's echoes below which a population ends
constexpr D MAT = 0.08, FEW = 10.0;  // m above the middle of the stubble: of crop that lies flat; echoes that show it
constexpr D COMES_AGAIN = 0.1;  // share of the echoes of a layer: fewer that come again are dust
constexpr D TOP = 0.9;          // share of the echoes of a stand below its height
constexpr D SAMPLE = 0.5, NO_COUNTS = 1e-9;  // counts added to each class; in the place of none, to divide by

struct Layers {  // counts of echoes from the lowest layer on
  static D middle(int k) { return LOWEST + LAYER * (k + 0.5); }
  // the first layer above the fullest one that holds little of what that holds
  __attribute__((noinline)) static int end_of_peak(const D* layers) {
    D smooth[LAYERS];
    int peak = 0;
    for (int k = 0; k < LAYERS; ++k) {
      const D below = k ? layers[k - 1] : 0.0, above = k + 1 < LAYERS ? layers[k + 1] : 0.0;
      smooth[k] = 0.25 * below + 0.5 * layers[k] + 0.25 * above;
      if (smooth[k] > smooth[peak]) peak = k;
    }
    for (int k = peak; k < LAYERS; ++k)
      if (smooth[k] < LITTLE * smooth[peak]) return k;
    return LAYERS;
  }
  // height [m] below which a share of the echoes lies, nan of none
  __attribute__((noinline)) static D percentile(const D* layers, D share) {
    D reached[LAYERS], tops[LAYERS], below = 0.0;
    const D total = sum(layers, LAYERS);
    if (total <= 0.0) return NO_NUMBER;
    for (int k = 0; k < LAYERS; ++k) {
      below += layers[k];
      reached[k] = below / total;
      tops[k] = LOWEST + LAYER * (k + 1);
    }
    return Np::interp(share, reached, tops, LAYERS);
  }
  // 90th percentile [m] of the echoes that belong to the canopy, nan when there are too few. The canopy reaches from layer `first`
  // over its fullest layer to where a tenth of that is left: puffs of dust above it do not count.
  __attribute__((noinline)) static D canopy_height(D* layers, int first) {
    for (int k = 0; k < LAYERS && k < first; ++k) layers[k] = 0.0;
    if (sum(layers, LAYERS) < 10.0) return NO_NUMBER;
    for (int k = end_of_peak(layers); k < LAYERS; ++k) layers[k] = 0.0;
    return percentile(layers, TOP);
  }
  static D median(const D* counts) {  // of the echoes among counts of classes [m], nan where they are few
    return sum(counts, LAYERS) > FEW ? percentile(counts, 0.5) : NO_NUMBER;
  }
};

struct Heights {  // canopy over the plane of the stubble, 90th percentile of that [m]; shares of rays that crop stopped, of dust
  D crop, stubble, stopped, dust;
};

// counts: of classes in the crop, beside it, the solid ones of both, and lately in the crop. Layers are counted over the plane of
// the stubble. In the air echoes do not come again from scan to scan: a layer where they do not is dust.
struct Populations : PopulationsRow {
  const D* of(int side) const { return counts + CLASSES * side; }
  void begin(const D* sides) {  // start with the counts of both sides, as `Block::sides`
    for (int k = 0; k < 5 * CLASSES; ++k) counts[k] = sides[k % (4 * CLASSES)];
  }
  void move(D travel) {  // old counts fade over a travel [m]
    const D keep = ::exp(-travel / MEMORY), keep_short = ::exp(-travel / SHORT);
    for (int k = 0; k < 5 * CLASSES; ++k) counts[k] *= k < 4 * CLASSES ? keep : keep_short;
  }
  void add(const D* sides) {  // counts of both sides of an edge that was accepted, as `Block::sides`
    for (int k = 0; k < 5 * CLASSES; ++k) counts[k] += sides[k % (4 * CLASSES)];
  }
  bool is_air(int layer) const {  // a layer of both sides
    const D echoes = of(0)[layer] + of(1)[layer], solid = of(2)[layer] + of(3)[layer];
    return COMES_AGAIN * echoes >= solid + 1.0;
  }
  void standing(const D* some, D* into) const {  // counts of classes without the layers in which nothing comes again
    for (int k = 0; k < LAYERS; ++k) into[k] = is_air(k) ? 0.0 : some[k];
  }
  __attribute__((noinline)) int first_layer() const {  // the lowest one that is no stubble
    D low[LAYERS];
    standing(of(1), low);
    for (int k = 0; k < LAYERS; ++k)
      if (!(Layers::middle(k) < STUBBLE_TO)) low[k] = 0.0;
    return Layers::end_of_peak(low) + 1;
  }
  static D share(D count, D all) { return (count + SAMPLE / CLASSES * 4.0) / all; }
  static D shares_sum(const D* some, int n) {
    return sum_of(n, [&](int k) { return some[k] + SAMPLE / CLASSES * 4.0; });
  }
  // What one more answer of each class is worth: log-likelihood ratio, crop over stubble [nat].
  struct Ratios {
    D crop[CLASSES], stubble[CLASSES];
    int top;  // a puff above the crop says nothing of what is behind it
    // haze: echoes of dust in a layer for each ray that gets there
    void at(D haze, D* into) const {
      for (int k = 0; k < CLASSES; ++k) {
        const D dust = haze * (k < LAYERS ? 1.0 : 0.0);
        const D worth = ::log((crop[k] + dust) / (stubble[k] + dust));
        into[k] = k >= top && k <= DUST ? 0.0 : within(-MOST_WORTH, worth, MOST_WORTH);
      }
    }
  };
  __attribute__((noinline)) Ratios ratios() const {
    Ratios r;
    D tall[LAYERS];
    const int first = first_layer();
    standing(of(0), tall);
    for (int k = 0; k < LAYERS && k < first; ++k) tall[k] = 0.0;
    const int peak = Layers::end_of_peak(tall) + 2;
    r.top = peak > first + 1 ? peak : first + 1;
    int above = 0;
    for (int k = first; k < r.top && k < CLASSES; ++k) ++above;
    const D sums[3] = {shares_sum(of(0), CLASSES), shares_sum(of(1), CLASSES), shares_sum(of(4), CLASSES)};
    for (int k = 0; k < CLASSES; ++k) {
      const D any = (k >= first && k < r.top ? 1.0 : 0.0) / larger(above, 1.0);
      const D crop = share(of(0)[k], sums[0]), lately = share(of(4)[k], sums[2]);
      r.crop[k] = (1.0 - FRESH - STRANGE) * crop + FRESH * lately + STRANGE * any;
      r.stubble[k] = (1.0 - STRAY) * share(of(1)[k], sums[1]) + STRAY / CLASSES;
    }
    return r;
  }
  __attribute__((noinline)) Heights heights() const {
    D crop[LAYERS], stubble[LAYERS];
    standing(of(0), crop);
    standing(of(1), stubble);
    const int first = first_layer(), from = first < LAYERS ? first : LAYERS;
    const D answered = sum(of(0), CLASSES) - (of(0)[DUST] + of(0)[AIR]);
    Heights h;
    h.dust = 0.0;
    for (int k = 0; k < 3; ++k) {  // on the stubble side "no echo" may be that of a ray along the ground
      const D* side = of(k == 2 ? 4 : k);
      const D lost = side[DUST] + side[AIR] + (k == 1 ? 0.0 : 1.0) * side[NOTHING];
      h.dust = larger(h.dust, lost / larger(sum(side, CLASSES), NO_COUNTS));
    }
    h.stubble = Layers::percentile(stubble, TOP);
    h.stopped = sum(crop + from, LAYERS - from) / larger(answered, NO_COUNTS);
    h.crop = Layers::canopy_height(crop, first);
    return h;
  }
  D top() const { return height_of(of(0)); }
  D height_of(const D* some) const {  // of the canopy over the plane [m] in counts of classes, nan where they hold little
    D layers[LAYERS];
    standing(some, layers);
    return Layers::canopy_height(layers, first_layer());
  }
  bool has_mat(const D* some) const {  // other counts show crop that lies flat: no canopy, but above the stubble
    return Layers::median(some) > Layers::median(of(1)) + MAT;
  }
  // Bhattacharyya coefficient of two rows of counts: of all rays, or, where less, of the echoes near
  static D overlap(const D* one, const D* other) {
    auto of = [&](int n) {
      const D all = shares_sum(one, n), all_other = shares_sum(other, n);
      return sum_of(n, [&](int k) { return __builtin_sqrt(share(one[k], all) * share(other[k], all_other)); });
    };
    return smaller(of(CLASSES), of(LAYERS));
  }
  // By how much the share of rays that crop may have stopped is higher in the crop than beside it: low echoes alone, or all: above
  // the first limit there may be puffs of dust, on the stubble side alone.
  static D crop_excess(const D* crop, const D* stubble) {
    auto share_to = [](const D* counts, D top) {
      int first = 0, end = 0;
      while (!(Layers::middle(first) > CROP_FROM)) ++first;
      while (end < LAYERS && top > Layers::middle(end)) ++end;
      return sum(counts + first, end - first) / larger(sum(counts, CLASSES), NO_COUNTS);
    };
    return larger(share_to(crop, LOW_CROP_TO) - share_to(stubble, LOW_CROP_TO), share_to(crop, CROP_TO) - share_to(stubble, CROP_TO));
  }
};
