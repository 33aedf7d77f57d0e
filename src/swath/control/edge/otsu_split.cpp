// Numbers in order, and the split of a profile: Otsu's threshold between heights, then the place that separates high from low best.

// The k-th smallest of n numbers, with none greater before it (Hoare's selection, in place)
static constexpr auto chosen = [](D* a, int n, int k) __attribute__((noinline)) {
  for (int low = 0, high = n - 1; low < high;) {
    const D pivot = a[k];
    int i = low, j = high;
    while (i <= j) {
      while (a[i] < pivot) ++i;
      while (pivot < a[j]) --j;
      if (i <= j) {
        const D kept = a[i];
        a[i++] = a[j];
        a[j--] = kept;
      }
    }
    if (j < k) low = i;
    if (k < i) high = j;
  }
  return a[k];
};
static constexpr auto median = [](D* a, int n) __attribute__((noinline)) {  // of n > 0 numbers, whose order changes
  const D upper = chosen(a, n, n / 2);
  if (n % 2 == 1) return upper;
  D lower = a[0];
  for (int i = 1; i < n / 2; ++i) lower = larger(lower, a[i]);
  return 0.5 * (lower + upper);
};
static constexpr auto share_of = [](D* a, int n, D share) { return chosen(a, n, (int)(share * n)); };
static constexpr auto copy = [](const D* from, int n, D* to) {
  for (int i = 0; i < n; ++i) to[i] = from[i];
  return to;
};
// n > 0 numbers: into bins first, then by insertion
static constexpr auto sorted = [](const D* from, int n, D* to) __attribute__((noinline)) {
  constexpr int PLACES = 256;
  D low = from[0], high = from[0];
  for (int i = 1; i < n; ++i) low = from[i] < low ? from[i] : low, high = from[i] > high ? from[i] : high;
  const D per = high - low > 1.0e-9 ? (PLACES - 1) / (high - low) : 0.0;
  int next[PLACES + 1] = {};
  for (int i = 0; i < n; ++i) ++next[1 + (int)((from[i] - low) * per)];
  for (int i = 0; i < PLACES; ++i) next[i + 1] += next[i];
  for (int i = 0; i < n; ++i) to[next[(int)((from[i] - low) * per)]++] = from[i];
  for (int i = 1; i < n; ++i) {
    const D kept = to[i];
    int j = i;
    for (; j > 0 && to[j - 1] > kept; --j) to[j] = to[j - 1];
    to[j] = kept;
  }
};
// Stable, for keys that are nearly in order; index: where each was
static constexpr auto sort_by = [](D* key, int* index, int n) __attribute__((noinline)) {
  for (int i = 0; i < n; ++i) {
    const D kept = key[i];
    int j = i;
    for (; j > 0 && key[j - 1] > kept; --j) key[j] = key[j - 1], index[j] = index[j - 1];
    key[j] = kept;
    index[j] = i;
  }
};
static constexpr auto mean = [](const D* a, int n) {
  D total = 0.0;
  for (int i = 0; i < n; ++i) total += a[i];
  return total / n;
};
static constexpr auto variance_of = [](const D* a, int n, D mean) {
  D total = 0.0;
  for (int i = 0; i < n; ++i) total += (a[i] - mean) * (a[i] - mean);
  return total / n;
};
// Threshold of n > 1 heights with the largest variance between both classes; values: scratch.
static constexpr auto otsu_threshold = [](const D* z, int n, D* values) {
  sorted(z, n, values);
  const D middle = mean(values, n);
  D centred = 0.0, most = -1.0;
  int best = 0;
  for (int i = 0; i < n - 1; ++i) {
    centred += values[i] - middle;
    const D low = i + 1, between = centred * centred / (low * (n - low));
    if (between > most) most = between, best = i;
  }
  return 0.5 * (values[best] + values[best + 1]);
};
// gain: log-likelihood that two populations gain over one [nat]; first: index of the first crop point
struct Split { D gain; int first; };
// The best of splits before each of the points 1..n-1; wrong: how many are on the wrong side of each, -1 = too few on one.
static constexpr auto split_by_otsu = [](const D* z, int n, D* values, int* wrong) __attribute__((noinline)) {
  auto coin = [n](int count) {  // entropy [nat] of n draws of which `count` fell on one side
    const D share = smaller(larger((D)count / n, TINY), 1.0 - TINY);
    return -(D)n * (share * ::log(share) + (1.0 - share) * ::log(1.0 - share));
  };
  const D threshold = otsu_threshold(z, n, values);
  int high = 0, before = 0, fewest = n + 1;
  Split split{0.0, 0};
  for (int i = 0; i < n; ++i) high += z[i] > threshold;
  for (int k = 1; k < n; ++k) {
    before += z[k - 1] > threshold;
    const bool is_asked = k >= MIN_POINTS && n - k >= MIN_POINTS;
    const int here = wrong[k - 1] = is_asked ? before + (n - high) - (k - before) : -1;
    if (is_asked && here < fewest) fewest = here, split.first = k;
  }
  split.gain = larger(coin(high) - coin(fewest), 0.0);
  return split;
};
