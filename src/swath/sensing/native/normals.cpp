// Standard normal numbers as numpy draws them from Philox 4x64 (sensing/normals.py): the body of a native function, after philox.cpp.
//
// In: keys (n, 2) of streams, the counter, widths and bounds of levels. Out: rows (n, k); slow: 1 where numpy has to draw a stream,
// and then needs, too.

constexpr W BITS = (1ull << 52) - 1;
const W* key = (const W*)keys.data;
const double* width = (const double*)widths.data;
const long long* bound = (const long long*)bounds.data;
for (int n = 0; n < rows.shape[0]; ++n) {
  double* row = (double*)((char*)rows.data + (size_t)n * rows.strides[0]);
  bool is_slow = false;
  for (int first = 0; first < rows.shape[1]; first += 4) {
    W words[4];
    philox((W)(first / 4 + 1), counter.data[0], key[2 * n], key[2 * n + 1], words);
    for (int i = 0; i < 4 && first + i < rows.shape[1]; ++i) {
      const W level = words[i] & 255, far = words[i] >> 9 & BITS;
      const double x = (double)far * width[level];
      row[first + i] = words[i] >> 8 & 1 ? -x : x;
      is_slow |= (long long)far >= bound[level];
    }
  }
  slow.data[n] = is_slow;
  if (is_slow) needs.data[0] = 1;
}
