// Before native functions of a detector: numbers as Python and numpy have them. What is `noinline` is compiled once, not where it
// is called: half the time that a module takes.

typedef double D;
auto larger = [](D a, D b) { return b > a ? b : a; };   // as `max` of Python
auto smaller = [](D a, D b) { return b < a ? b : a; };  // and `min`
auto within = [&](D low, D x, D high) { return smaller(larger(x, low), high); };
auto square = [](D x) {  // `x ** 2` of Python is the C library's `pow`, whose last bit is not always that of a product
  volatile D two = 2.0;
  return ::pow(x, two);
};
struct Pairs {
  static __attribute__((noinline)) D sum(const D* a, int n) {  // in numpy's order
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
};
auto sum = Pairs::sum;
// where a machine is that stood at a step's place when its scan ended, some seconds after that: along its heading, and aside by
// crab, the side slip of the fixed axle per side force in g
struct Frame { D x, u, angle; };
auto moved = [](const auto& d, const auto& step, D seconds) {
  const D crab = d.crab * (step.rise + d.sign * step.speed * step.yaw_rate / GRAVITY);
  const D course = step.heading + 0.5 * step.yaw_rate * seconds - d.sign * crab, way = step.speed * seconds;
  return Frame{step.x + way * ::cos(course), step.u + way * ::sin(course), step.heading + step.yaw_rate * seconds};
};
