// Before the body of a native function that adds numbers and takes lengths of vectors to the last bit, as `math.fsum` and
// `math.hypot` do: sums and squares with what rounding leaves over.

auto exact_square = [](double a, double& left) {  // Dekker 1971
  const double t = 134217729.0 * a, high = t - (t - a), low = a - high, p = a * a;
  left = ((high * high - p) + 2.0 * (high * low)) + low * low;
  return p;
};
struct ExactSum {  // Knuth's sum, its errors added up
  double sum = 0.0, rest = 0.0;
  void add(double x) {
    const double next = sum + x, back = next - sum;
    rest += (sum - (next - back)) + (x - back);
    sum = next;
  }
};
auto exact_length = [&](const double* v, int count) {
  ExactSum squares;
  double lefts = 0.0;
  for (int i = 0; i < count; ++i) {
    double left;
    squares.add(exact_square(v[i], left));
    lefts += left;
  }
  const double rest = squares.rest + lefts, whole = squares.sum + rest, below = rest - (whole - squares.sum);
  if (!(whole > 0.0)) return whole;
  const double root = __builtin_sqrt(whole);
  double left;
  const double p = exact_square(root, left);
  return root + (((whole - p) - left) + below) / (2.0 * root);
};
