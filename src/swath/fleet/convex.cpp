// Boxes (west, south, east, north) that lie apart, and outlines of corners x, y in turn, of which a side of one separates the other: the
// begin of native functions that ask which of them touch.

auto apart = [](const double* a, const double* b) { return a[0] > b[2] || b[0] > a[2] || a[1] > b[3] || b[1] > a[3]; };
auto separates = [](const double* a, int n, const double* b, int k) {  // a side of a has all of b outside
  for (int i = 0; i < n; ++i) {
    const double *p = a + 2 * i, *q = a + 2 * (i + 1 < n ? i + 1 : 0), dx = q[0] - p[0], dy = q[1] - p[1];
    bool outside = true;
    for (int j = 0; j < k && outside; ++j) outside = dx * (b[2 * j + 1] - p[1]) - dy * (b[2 * j] - p[0]) < 0.0;
    if (outside) return true;
  }
  return false;
};
