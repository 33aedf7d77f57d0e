// Number of cells in a convex polygon on which crop stands: the body of one native function (cut_kernel.py).
//
// In: land, edges (x, y of a corner, dx/dy and dy to the next one); of `ask` the number of corners, first row, last row.
// Out: report[0] 1 where a page is not in memory, else 0; report[1] the number.

constexpr int PAGE = 512, STANDING = 255;  // as in land_kernel.py
const int corners = ask.data[0], first_row = ask.data[1], last_row = ask.data[2];
const int nx = land.table.shape[1], ny = land.table.shape[0];
int found = 0;
report.data[0] = 1;
for (int row = first_row; row <= last_row; ++row) {
  const double y = (double)row + 0.5;
  double low = -1.0e300, high = 1.0e300;
  for (int k = 0; k < corners; ++k) {
    const auto& edge = edges.data[k];
    if (edge[3] == 0.0) continue;
    const double x = edge[0] + edge[2] * (y - edge[1]);
    if (edge[3] > 0.0) high = x < high ? x : high; else low = x > low ? x : low;
  }
  if (low < -1.0e299 || high > 1.0e299) continue;
  const int begin = (int)__builtin_ceil(low - 0.5), after = (int)__builtin_floor(high - 0.5) + 1;
  for (int c = begin; c < after;) {
    const int end = ((c >> 6) + 1) << 6, until = end < after ? end : after;  // within a tile
    const int i = (c >> 9) - land.table_x, j = (row >> 9) - land.table_y;
    const int slot = i < 0 || j < 0 || i >= nx || j >= ny ? -1 : land.table.data[j * nx + i];
    if (slot < 0) return;
    const int line = land.cut_slot.data[slot];
    if (land.tile_stand.data[64 * slot + ((row & 511) >> 6) * 8 + ((c & 511) >> 6)][3] > 0.0f) {
      if (line < 0) {
        found += -1 - line == STANDING ? until - c : 0;
      } else {
        const unsigned char* codes = land.cut.data + (long long)line * PAGE * PAGE + (row & 511) * PAGE + (c & 511);
        for (int k = 0; k < until - c; ++k) found += codes[k] == STANDING;
      }
    }
    c = until;
  }
}
report.data[0] = 0;
report.data[1] = found;
