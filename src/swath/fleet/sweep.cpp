// The ground that a body's rectangles sweep over each segment of a path: the convex hull of their corners (Andrew's
// monotone chain), anticlockwise. The body of a native function; its arrays are those of table.py.
//
// numbers: hitch, drawbar [m], rectangles, of which towed, segments, samples; 6 in all. Of a segment on which nothing turns,
// the ends are enough.

typedef double D;
const D* m = (const D*)its.numbers.data;
const D* at = (const D*)its.places.data;
const D* parts = (const D*)its.rectangles.data;
const int *from = (const int*)its.first.data, *to = (const int*)its.last.data;
D *points = (D*)its.outlines.data, *corners = (D*)its.room.data;
int* begins = (int*)its.starts.data;
const D hitch = m[0], drawbar = m[1];
const int count = (int)m[2], towed = (int)m[3], rows = (int)m[4], samples = (int)m[5];
auto before = [](const D* a, const D* b) { return a[0] < b[0] || (a[0] == b[0] && a[1] < b[1]); };
// to 0.1 um: corners above each other get the same x, so that rounding does not put them out of the chain's order
auto rounded = [](D a) { return __builtin_floor(a * 1e7 + 0.5) * 1e-7; };
int total = 0;
begins[0] = 0;
for (int s = 0; s < rows; ++s) {
  D low[2] = {1e18, 1e18}, high[2] = {-1e18, -1e18};
  for (int i = from[s]; i <= to[s]; ++i)
    for (int k = 0; k < 2; ++k) {
      const D angle = at[4 * i + 2 + k];
      low[k] = angle < low[k] ? angle : low[k]; high[k] = angle > high[k] ? angle : high[k];
    }
  const bool turns = high[0] - low[0] > 1e-9 || high[1] - low[1] > 1e-9;
  for (int r = 0; r < count; ++r) {
    const D* part = parts + 4 * r;
    int n = 0;
    for (int i = from[s]; i <= to[s]; i = turns || i == to[s] ? i + 1 : to[s]) {
      const D* p = at + 4 * i;
      D x = p[0], y = p[1], c = cos(p[2]), w = sin(p[2]);
      if (r >= count - towed) {
        x += hitch * c; y += hitch * w;
        c = cos(p[3]); w = sin(p[3]);
        x -= drawbar * c; y -= drawbar * w;
      }
      for (int k = 0; k < 4; ++k) {
        const D u = part[k == 1 || k == 2], v = part[2 + (k > 1)], px = rounded(x + u * c - v * w), py = rounded(y + u * w + v * c);
        D q[2] = {px, py};
        int j = n++;
        for (; j > 0 && before(q, corners + 2 * (j - 1)); --j) { corners[2 * j] = corners[2 * j - 2]; corners[2 * j + 1] = corners[2 * j - 1]; }
        corners[2 * j] = px; corners[2 * j + 1] = py;
      }
    }
    D* hull = points + 2 * total;
    int size = 0;
    for (int turn = 0; turn < 2; ++turn) {  // below, then above
      const int least = size + 1;
      for (int k = 0; k < n; ++k) {
        const D* q = corners + 2 * (turn ? n - 1 - k : k);
        while (size > least) {
          const D *a = hull + 2 * (size - 2), *b = hull + 2 * (size - 1);
          if ((b[0] - a[0]) * (q[1] - a[1]) - (b[1] - a[1]) * (q[0] - a[0]) > 1e-9) break;
          --size;
        }
        hull[2 * size] = q[0]; hull[2 * size + 1] = q[1]; ++size;
      }
      --size;  // the last one begins the other half
    }
    total += size;
    begins[s * count + r + 1] = total;
  }
}
