// Before native functions: numbers as Python and numpy have them. What is `noinline` is compiled once, not where it
// is called: half the time that a module takes.

typedef double D;
constexpr D NO_NUMBER = __builtin_nan(""), INFINITE = __builtin_inf();
static constexpr auto larger = [](D a, D b) { return b > a ? b : a; };   // as `max` of Python
static constexpr auto smaller = [](D a, D b) { return b < a ? b : a; };  // and `min`
static constexpr auto within = [](D low, D x, D high) { return smaller(larger(x, low), high); };
static constexpr auto square = [](D x) {  // `x ** 2` of Python is the C library's `pow`, whose last bit is not always that of a product
  volatile D two = 2.0;
  return ::pow(x, two);
};
struct Np {  // as numpy has it
  static __attribute__((noinline)) D sum(const D* a, int n) {  // of halves, down to 128 numbers, these in eight rows
    if (n > 128) {
      const int half = n / 2 - n / 2 % 8;
      return sum(a, half) + sum(a + half, n - half);
    }
    D r[8], whole = 0.0;
    int i = 0;
    if (n >= 8) {
      for (; i < 8; ++i) r[i] = a[i];
      for (; i < n - n % 8; i += 8)
        for (int k = 0; k < 8; ++k) r[k] += a[i + k];
      whole = ((r[0] + r[1]) + (r[2] + r[3])) + ((r[4] + r[5]) + (r[6] + r[7]));
    }
    for (; i < n; ++i) whole += a[i];
    return whole;
  }
  __attribute__((noinline)) static D dot(const D* a, const D* b, int n) {  // as `einsum` adds along both, in two lanes
    D lanes[2] = {0.0, 0.0};
    int i = 0;
    for (; n - i >= 8; i += 8)
      for (int k = 6; k >= 0; k -= 2)
        for (int lane = 0; lane < 2; ++lane) lanes[lane] = a[i + k + lane] * b[i + k + lane] + lanes[lane];
    for (; i < n; ++i) lanes[i % 2] = a[i] * b[i] + lanes[i % 2];
    return lanes[0] + lanes[1];
  }
  // y at x on the line through points (xs, ys), whose xs do not fall; as its ends beyond them
  __attribute__((noinline)) static D interp(D x, const D* xs, const D* ys, int n) {
    int k = n - 1;
    while (k >= 0 && !(xs[k] <= x)) --k;
    if (k < 0) return ys[0];
    if (k == n - 1 || xs[k] == x) return ys[k];
    const D slope = (ys[k + 1] - ys[k]) / (xs[k + 1] - xs[k]);
    return slope * (x - xs[k]) + ys[k];
  }
  __attribute__((noinline)) static void sort(D* a, int n) {
    for (int gap = n / 2; gap > 0; gap /= 2)
      for (int i = gap; i < n; ++i) {
        const D v = a[i];
        int k = i;
        for (; k >= gap && a[k - gap] > v; k -= gap) a[k] = a[k - gap];
        a[k] = v;
      }
  }
  static D median(D* some, int n) {  // of numbers that are in order then
    sort(some, n);
    return n % 2 ? some[n / 2] : 0.5 * (some[n / 2 - 1] + some[n / 2]);
  }
  static D percentile(D* some, int n, D share) {
    sort(some, n);
    const D place = (n - 1) * share;
    const int first = (int)place, next = first + 1 < n ? first + 1 : first;
    const D t = place - first, apart = some[next] - some[first];
    return t >= 0.5 ? some[next] - apart * (1.0 - t) : some[first] + apart * t;
  }
  // a b of a matrix of 3 x 3 and a vector, a p a' of such matrices: as `portable.product` adds
  static void times(const D* a, const D* b, D* into) {
    for (int i = 0; i < 3; ++i) into[i] = (a[3 * i] * b[0] + a[3 * i + 2] * b[2]) + a[3 * i + 1] * b[1];
  }
  __attribute__((noinline)) static void transform(const D* a, const D* p, D* into) {
    for (int i = 0; i < 3; ++i) {
      D row[3];
      for (int j = 0; j < 3; ++j) row[j] = (a[3 * i] * p[j] + a[3 * i + 1] * p[3 + j]) + a[3 * i + 2] * p[6 + j];
      times(a, row, into + 3 * i);
    }
  }
};
static constexpr auto sum = Np::sum;
static constexpr auto sum_of = [](int n, auto number) {  // of at most 384 numbers: of each place
  D all[384];
  for (int i = 0; i < n; ++i) all[i] = number(i);
  return sum(all, n);
};
static constexpr auto mean_of = [](const D* a, int n) { return sum(a, n) / n; };
static constexpr auto whole_of = [](D x) { return (int)__builtin_rint(x); };  // as `round` of Python
