// The cut of convex polygons in a world, row of cells by row of cells: the body of one native function (cut_kernel.py), after pages.cpp and tops.cpp.
//
// In: `its` as `Work`, of a polygon its area and the code of the cut; a code of STANDING only counts what stands. Sums go row by row from
// below, in each from left to right; they stay as they are where Python has to cut, and so does the field.

struct Span { int first, after; };  // cells of a row whose middles lie in the polygon
struct Spans { Span of[CELLS]; };   // of the rows of a row of tiles
constexpr int AHEAD = 8;  // lines of cells, whose codes are asked of memory so early; changes no result, estimated
struct Edge { double x, y, slope, dy; };  // from a corner to the next one, in cells of the stand frame; dx/dy
typedef double D __attribute__((vector_size(32)));
typedef long long L __attribute__((vector_size(32)));
const auto& roots = its.roots.data[w];
each_polygon(w, its, [&](const auto& land, const Asked& polygon, double* sums) -> bool {
  const int corners = (int)polygon.corners, code = (int)polygon.second;
  const double cell = land.tile_size / CELLS, cos_yaw = land.turn[0], sin_yaw = land.turn[1];
  Used* pages = (Used*)its.pages.data + PAGES_MAX * w;
  unsigned char tiles[PAGES_MAX][CELLS];  // 1 = some cell of it changed, 2 = it got lower too
  Edge edges[CORNERS_MAX];
  double lowest = 1.0e300, highest = -1.0e300;
  for (int k = 0; k < corners; ++k) {
    const Point at = polygon.at[k];
    edges[k] = {(cos_yaw * at.x + sin_yaw * at.y) / cell, (cos_yaw * at.y - sin_yaw * at.x) / cell, 0.0, 0.0};
    lowest = edges[k].y < lowest ? edges[k].y : lowest, highest = edges[k].y > highest ? edges[k].y : highest;
  }
  for (int k = 0; k < corners; ++k) {
    const Edge& to = edges[k + 1 < corners ? k + 1 : 0];
    edges[k].dy = to.y - edges[k].y;
    if (edges[k].dy != 0.0) edges[k].slope = (to.x - edges[k].x) / edges[k].dy;
  }
  const int begin = (int)__builtin_ceil(lowest - 0.5), end = (int)__builtin_floor(highest - 0.5);
  const int first_row = begin > its.rows.data[w][0] ? begin : its.rows.data[w][0], last_row = end < its.rows.data[w][1] ? end : its.rows.data[w][1];

  constexpr int KEPT = 16;  // rows of tiles whose spans are found once: of a header 12 m wide and more
  Spans kept[KEPT], others;
  auto find_spans = [&](int first, int last, bool is_again = false) -> const Spans& {  // of rows of one row of tiles, four at a time
    const int number = (first >> 6) - (first_row >> 6);
    Spans& spans = number < KEPT ? kept[number] : others;
    if (is_again && number < KEPT) return spans;
    for (int row = first; row <= last; row += 4) {
      const D y = D{0.0, 1.0, 2.0, 3.0} + (double)row + 0.5;
      D low = D{} - 1.0e300, high = D{} + 1.0e300;
      for (int k = 0; k < corners; ++k) {
        const Edge& edge = edges[k];
        if (edge.dy == 0.0) continue;
        const D x = edge.x + edge.slope * (y - edge.y);
        if (edge.dy > 0.0) high = x < high ? x : high; else low = x > low ? x : low;
      }
      const D begin = __builtin_elementwise_ceil(low - 0.5), end = __builtin_elementwise_floor(high - 0.5) + 1.0;
      for (int k = 0; k < 4 && row + k <= last; ++k) {
        const bool is_open = low[k] < -1.0e299 || high[k] > 1.0e299;
        spans.of[row + k - first] = is_open ? Span{0, 0} : Span{(int)begin[k], (int)end[k]};
      }
    }
    return spans;
  };
  auto last_of_tiles = [&](int row) -> int { const int last = (row & ~(CELLS - 1)) + CELLS - 1; return last < last_row ? last : last_row; };
  auto number_of = [&](int count, int i, int j) -> int {  // of page (i, j) in the list of those of this cut, -1: not there
    for (int n = 0; n < count; ++n) if (pages[n].i == i && pages[n].j == j) return n;
    return -1;
  };

  // ---- The pages of the cut, sorted by j and i: are all of them ready?
  int count = 0;
  bool is_ready = true;
  for (int row = first_row; row <= last_row; row = last_of_tiles(row) + 1) {
    const int last = last_of_tiles(row), j = row >> 9;
    const Spans& spans = find_spans(row, last);
    int low = 0, high = -1;  // cells of the pages looked at last
    for (int r = row; r <= last; ++r) {
      const Span span = spans.of[r - row];
      if (span.first >= span.after || (span.first >= low && span.after - 1 <= high)) continue;
      for (int i = span.first >> 9; i <= (span.after - 1) >> 9; ++i) {
        if (number_of(count, i, j) < 0) {
          if (count == PAGES_MAX) {
            pages[0] = {first_row, last_row, 0, 0}, sums[LACKED] = -1.0;
            return false;
          }
          __builtin_memset(tiles[count], 0, CELLS);
          Used* at = pages + count++;
          for (; at > pages && (at[-1].j > j || (at[-1].j == j && at[-1].i > i)); --at) *at = at[-1];
          *at = {i, j, 0, 0};
        }
        const int slot = slot_at(land, i, j);  // in memory, and with codes of its own unless it is this low already?
        if (slot < 0 || (land.cut_slot.data[slot] < 0 && -1 - land.cut_slot.data[slot] > code)) is_ready = false;
      }
      low = (span.first >> 9) * PAGE, high = (((span.after - 1) >> 9) + 1) * PAGE - 1;
    }
  }
  if (!is_ready || !has_room(land, count)) {
    sums[LACKED] = count;
    return false;
  }

  // ---- The cells, and the stems on them
  struct Sum { double grain, straw, left; };
  auto add = [&](Sum& sum, const auto& stem, double scale, double length, int at) {  // what a cut at this code takes of a stem
    const double height = 0.01 * at, share = 1.0 - height / (stem.height * scale);
    const double above = share < 0.0 ? 0.0 : share > 1.0 ? 1.0 : share;
    const bool is_taken = stem.ear * scale > height;
    sum.grain += is_taken ? stem.grain : 0.0;
    sum.straw += stem.straw * length * wp::pow(above, roots.straw_exponent);
    sum.left += is_taken ? 0.0 : stem.grain;
  };
  struct Tile {  // what holds on all of a tile; x: its number from the origin
    int x, number, page, variant;
    unsigned char* codes;  // of its page, nullptr: `code` is that of all of it, no higher than the one asked for
    int code;
    double rank, scale, length;
  };
  auto look = [&](int tile_x, int tile_y) -> Tile {
    const int i = tile_x >> 3, j = tile_y >> 3, number = (tile_y & 7) * 8 + (tile_x & 7), slot = slot_at(land, i, j), line = land.cut_slot.data[slot];
    const auto& stand = land.tile_stand.data[64 * slot + number];
    const int prototype = land.tile_prototype.data[64 * slot + number];
    const int variant = ((prototype & 65535) * 4 + (prototype >> 16 & 3)) * CELLS;  // first line of the prototype, mirrored as it is
    const double scale = stand[0], lean_x = stand[1], lean_y = stand[2];
    unsigned char* codes = line < 0 ? nullptr : land.cut.data + (long long)line * PAGE * PAGE;
    return {tile_x, number, number_of(count, i, j), variant, codes, -1 - line, stand[3], scale, __builtin_sqrt(scale * scale + lean_x * lean_x + lean_y * lean_y)};
  };
  Sum taken = {}, again = {};  // in all; by earlier cuts
  int newly = 0, crop = 0, changed = 0;
  for (int row = first_row; row <= last_row; row = last_of_tiles(row) + 1) {
    const int last = last_of_tiles(row);
    const Spans& spans = find_spans(row, last, true);
    Tile tile;
    bool is_known = false;
    for (int r = row; r <= last; ++r) {
      const Span span = spans.of[r - row];
      for (int c = span.first; c < span.after;) {
        const int tile_x = c >> 6, end = (tile_x + 1) * CELLS, after = end < span.after ? end : span.after;
        if (!is_known || tile_x != tile.x) tile = look(tile_x, r >> 6), is_known = true;
        if (tile.codes) {
          unsigned char* codes = tile.codes + (r & 511) * PAGE + (tile_x & 7) * CELLS;  // of this row of the tile
          const int line = tile.variant + (r & 63), low = c & 63, high = low + after - c;
          __builtin_prefetch(codes + low + AHEAD * PAGE);
          const bool has_some = code != STANDING && roots.taken.data[line] >> low << (CELLS - (high - low)) != 0;
          for (int s = roots.first.data[line], end = roots.first.data[line + 1]; has_some && s < end; ++s) {
            const auto& at = roots.at.data[s];
            const int column = at[1], old = codes[column];
            if (column < low || column >= high || old <= code) continue;
            const auto& stem = roots.stems.data[at[0] < 0 ? -1 - at[0] : at[0]];
            if (stem.rank >= tile.rank) continue;
            add(taken, stem, tile.scale, tile.length, code);
            if (old == STANDING) crop += at[0] >= 0; else add(again, stem, tile.scale, tile.length, old);
          }
          int lowered = 0;
#pragma clang loop vectorize(disable) unroll(disable)  // few cells
          for (int k = low; k < high; ++k) {
            const int old = codes[k];
            newly += old == STANDING && tile.rank > 0.0;
            if (old <= code) continue;
            codes[k] = (unsigned char)code;
            ++lowered;
          }
          changed += lowered;
          if (lowered) tiles[tile.page][tile.number] = 1, pages[tile.page].is_cut = 1;
        } else if (tile.code == STANDING && tile.rank > 0.0) newly += after - c;
        c = after;
      }
    }
  }
  const double terms[6] = {taken.grain - again.grain, taken.straw - again.straw, taken.left - again.left, newly * land.cell_area, (double)crop, polygon.first};
  for (int k = 0; k < 6; ++k) sums[k] += terms[k];

  // ---- Tiles that got lower, and the tops of those that show what stood on them
  auto highest_on = [&](const unsigned char* codes) -> int {  // of a tile; its corners first, since most are not cut wholly
    constexpr int END = CELLS - 1;
    const int corners[4] = {codes[0], codes[END], codes[END * PAGE], codes[END * PAGE + END]};
    int found = 0;
    for (const int here : corners) found = here > found ? here : found;
    for (int y = 0; y < CELLS && found < STANDING; ++y)
      for (int x = 0; x < CELLS; ++x) found = codes[y * PAGE + x] > found ? codes[y * PAGE + x] : found;
    return found;
  };
  auto write_tops = [&](int tile_x, int tile_y) {
    constexpr int FAR_OFF = 4;  // tiles, as `reach_of` at most
    for (int v = tile_y - FAR_OFF; v <= tile_y + FAR_OFF; ++v)
      for (int u = tile_x - FAR_OFF; u <= tile_x + FAR_OFF; ++u) {
        const int slot = slot_at(land, u >> 3, v >> 3), at = 64 * slot + (v & 7) * 8 + (u & 7), reach = slot < 0 ? -1 : reach_of(land, at);
        if (u - tile_x <= reach && tile_x - u <= reach && v - tile_y <= reach && tile_y - v <= reach) write_top(land, u, v, at, reach);
      }
  };
  for (int n = 0; n < count; ++n) {
    const int slot = slot_at(land, pages[n].i, pages[n].j);
    const unsigned char* codes = land.cut.data + (long long)land.cut_slot.data[slot] * PAGE * PAGE;
    for (int t = 0; t < CELLS; ++t) {
      if (!tiles[n][t]) continue;
      const int found = highest_on(codes + (t >> 3) * CELLS * PAGE + (t & 7) * CELLS);
      unsigned char& known = land.code_max.data[64 * slot + t];
      if (found < known) known = (unsigned char)found, tiles[n][t] = 2, pages[n].is_lower = 1;
    }
  }
  for (int n = 0; n < count; ++n)
    for (int t = 0; t < CELLS && pages[n].is_lower; ++t)
      if (tiles[n][t] == 2) write_tops(pages[n].i * TILES + (t & 7), pages[n].j * TILES + (t >> 3));
  for (int n = 0; n < count && code != STANDING; ++n) touch(land, pages[n]);
  if (changed) ++land.counters.data[REVISION];
  return true;
});
