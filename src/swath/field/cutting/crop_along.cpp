// Whether crop stands at places along lines: the body of one native function (cut_kernel.py).
//
// In: land, starts (n, 2), step (2,) in cells. Out: crop (n, count) at the middles of the steps; is_missing: 1 where a page is not
// in memory.

constexpr int PAGE = 512, STANDING = 255;  // as in land_kernel.py
constexpr int ROOM = 64;                   // places whose cells are found at once
const int lines = crop.shape[0], count = crop.shape[1], nx = land.table.shape[1], ny = land.table.shape[0];
const double dx = step.data[0], dy = step.data[1];
for (int n = 0; n < lines; ++n) {
  const double x0 = starts.data[2 * n], y0 = starts.data[2 * n + 1];
  int page_x = 0, page_y = 0, slot = -1, code = 0;
  const unsigned char* codes = nullptr;  // of the page, nullptr: `code` is that of all of it
  for (int from = 0; from < count; from += ROOM) {
    int x[ROOM], y[ROOM];
    for (int k = 0; k < ROOM; ++k) {
      const double along = (double)(from + k) + 0.5;
      x[k] = (int)__builtin_floor(x0 + dx * along), y[k] = (int)__builtin_floor(y0 + dy * along);
    }
    const int room = count - from < ROOM ? count - from : ROOM;
    for (int k = 0; k < room;) {
      const int i = x[k] >> 9, j = y[k] >> 9;
      if (slot < 0 || i != page_x || j != page_y) {
        const int column = i - land.table_x, row = j - land.table_y;
        slot = column < 0 || row < 0 || column >= nx || row >= ny ? -1 : land.table.data[row * nx + column];
        if (slot < 0) { is_missing.data[0] = 1; return; }
        const int line = land.cut_slot.data[slot];
        page_x = i, page_y = j, code = -1 - line;
        codes = line < 0 ? nullptr : land.cut.data + (long long)line * PAGE * PAGE;
      }
      const bool is_whole = x[room - 1] >> 9 == i && y[room - 1] >> 9 == j;  // a line leaves a page once
      const auto* stand = land.tile_stand.data + 64 * slot;
      bool* to = (bool*)crop.data + n * count + from;
      int next = k;
      for (; next < room && (is_whole || (x[next] >> 9 == i && y[next] >> 9 == j)); ++next) {
        const int u = x[next] & 511, v = y[next] & 511, here = codes ? codes[v * PAGE + u] : code;
        to[next] = here == STANDING && stand[(v >> 6) * 8 + (u >> 6)][3] > 0.0f;
      }
      k = next;
    }
  }
}
