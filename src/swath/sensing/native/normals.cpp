// Standard normal numbers as numpy draws them from Philox 4x64 (sensing/normals.py): the body of a native function, after philox.cpp.
//
// In: keys (n, 2) of streams, the counter, widths, heights and bounds of levels. Out: rows (n, k); slow: 1 where numpy has to draw a
// stream, and then needs, too: a number of the tail, or one so near to a bound that this may take it for the other side.

constexpr W BITS = (1ull << 52) - 1;
constexpr long long UNSURE = 128;  // twice DOUBT of sensing/normals.py
constexpr double NEAR = 1.0e-12;   // of the height of the density
const W* key = (const W*)keys.data;
const double *width = (const double*)widths.data, *height = (const double*)heights.data;
const long long* bound = (const long long*)bounds.data;
for (int n = 0; n < rows.shape[0]; ++n) {
  double* row = (double*)((char*)rows.data + (size_t)n * rows.strides[0]);
  bool is_slow = false;
  W words[4];
  int taken = 0;
  const auto next = [&]() -> W {
    if (taken % 4 == 0) philox((W)(taken / 4 + 1), counter.data[0], key[2 * n], key[2 * n + 1], words);
    return words[taken++ % 4];
  };
  for (int i = 0; i < rows.shape[1] && !is_slow; ++i) {
    for (bool is_drawn = false; !is_drawn;) {
      const W word = next(), level = word & 255, far = word >> 9 & BITS;
      const double x = (double)far * width[level];
      row[i] = word >> 8 & 1 ? -x : x;
      is_drawn = (long long)far < bound[level];
      if (is_drawn) break;
      is_slow = level == 0 || (long long)far < bound[level] + UNSURE;
      if (!is_slow) {  // between the level and the density: drawn again where it is above that
        const double u = (double)(next() >> 11) * 0x1p-53;
        const double above = height[level] + u * (height[level - 1] - height[level]) - ::exp(-0.5 * x * x);
        is_slow = !(__builtin_fabs(above) > NEAR);
        is_drawn = above < 0.0;
      }
      is_drawn |= is_slow;
    }
  }
  slow.data[n] = is_slow;
  if (is_slow) needs.data[0] = 1;
}
