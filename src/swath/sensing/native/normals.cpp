// Standard normal numbers as numpy draws them from Philox 4x64 (sensing/normals.py): the body of a native function.
//
// In: keys (n, 2) of streams, the counter, widths and bounds of levels. Out: rows (n, k); slow: 1 where numpy has to draw a stream,
// and then needs, too.

typedef unsigned long long W;
constexpr W BITS = (1ull << 52) - 1;
const W* key = (const W*)keys.data;
const double* width = (const double*)widths.data;
const long long* bound = (const long long*)bounds.data;
for (int n = 0; n < rows.shape[0]; ++n) {
  double* row = (double*)((char*)rows.data + (size_t)n * rows.strides[0]);
  bool is_slow = false;
  for (int first = 0; first < rows.shape[1]; first += 4) {
    W c0 = (W)(first / 4 + 1), c1 = 0, c2 = 0, c3 = counter.data[0], k0 = key[2 * n], k1 = key[2 * n + 1];
    for (int round = 0; round < 10; ++round) {
      const unsigned __int128 a = (unsigned __int128)0xD2E7470EE14C6C93ull * c0, b = (unsigned __int128)0xCA5A826395121157ull * c2;
      c0 = (W)(b >> 64) ^ c1 ^ k0;
      c1 = (W)b;
      c2 = (W)(a >> 64) ^ c3 ^ k1;
      c3 = (W)a;
      k0 += 0x9E3779B97F4A7C15ull;
      k1 += 0xBB67AE8584CAA73Bull;
    }
    const W words[4] = {c0, c1, c2, c3};
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
