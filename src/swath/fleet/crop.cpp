// Cells whose middles are in convex polygons: from when all of them are free, but for those that are free after a time, or
// that they are cut by a time. The body of a native function; its arrays are those of ground.py.
//
// numbers: cells along x and y, their size, west, south [m], polygons, whether crop is cut, the time after which [s]

const double* m = (const double*)its.numbers.data;
const double* p = (const double*)its.points.data;
const int* begins = (const int*)its.starts.data;
float* free_from = (float*)its.cells.data;
double* time = (double*)its.times.data;
const int nx = (int)m[0], ny = (int)m[1], count = (int)m[5];
const double cell = m[2], west = m[3], south = m[4];
const bool is_cut = m[6] > 0.5;
const double until = m[7];
for (int n = 0; n < count; ++n) {
  double low[2] = {1e18, 1e18}, high[2] = {-1e18, -1e18}, area = 0.0;
  for (int k = begins[n]; k < begins[n + 1]; ++k) {
    for (int a = 0; a < 2; ++a) {
      const double v = p[2 * k + a];
      low[a] = v < low[a] ? v : low[a]; high[a] = v > high[a] ? v : high[a];
    }
    if (k + 1 < begins[n + 1]) area += p[2 * k] * p[2 * k + 3] - p[2 * k + 2] * p[2 * k + 1];
  }
  const double turn = area < 0.0 ? -1.0 : 1.0;
  int i0 = (int)((low[0] - west) / cell) - 1, j0 = (int)((low[1] - south) / cell) - 1;
  int i1 = (int)((high[0] - west) / cell) + 2, j1 = (int)((high[1] - south) / cell) + 2;
  i0 = i0 < 0 ? 0 : i0; j0 = j0 < 0 ? 0 : j0; i1 = i1 > nx ? nx : i1; j1 = j1 > ny ? ny : j1;
  for (int i = i0; i < i1; ++i)
    for (int j = j0; j < j1; ++j) {
      const double x = west + cell * (i + 0.5), y = south + cell * (j + 0.5);
      bool inside = true;
      for (int k = begins[n]; k + 1 < begins[n + 1] && inside; ++k)
        inside = turn * ((p[2 * k + 2] - p[2 * k]) * (y - p[2 * k + 1]) - (p[2 * k + 3] - p[2 * k + 1]) * (x - p[2 * k])) > 1e-9;
      if (!inside) continue;
      float& f = free_from[i * ny + j];
      if (is_cut) { if (f > time[n]) f = (float)time[n]; }
      else if (f > time[n] && f <= until) time[n] = f;
    }
}
