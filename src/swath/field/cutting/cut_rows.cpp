// The cut of a convex polygon, row of cells by row of cells: the body of one native function (cut_kernel.py).
//
// In: land, roots, edges (x, y of a corner, dx/dy and dy to the next one); of `ask` the number of corners, first row, last row, code.
// Out: pages and tiles, masses, report as `cut_cells` says. Sums go row by row from below, in each from left to right.

constexpr int CELLS = 64, PAGE = 512, STANDING = 255, PAGES_MAX = 256;     // as in land_kernel.py, cut_kernel.py
constexpr int STATUS = 0, PAGE_COUNT = 1, NEWLY_CUT = 2, CROP_STEMS = 3, CHANGED = 4;
const int corners = ask.data[0], first_row = ask.data[1], last_row = ask.data[2], code = ask.data[3];
const int table_nx = land.table.shape[1], table_ny = land.table.shape[0];
int* page_rows = pages.data;            // (PAGES_MAX, 4)
unsigned char* tile_marks = tiles.data;  // (PAGES_MAX, 64)

struct Span { int first, after; };  // cells of a row whose middles lie in the polygon
struct Spans { Span of[CELLS]; };   // of the rows of a row of tiles

// Rows first..last of one row of tiles, four at a time
typedef double D __attribute__((vector_size(32)));
typedef long long L __attribute__((vector_size(32)));
auto find_spans = [&](Spans& spans, int first, int last) {
  for (int row = first; row <= last; row += 4) {
    const D y = D{0.0, 1.0, 2.0, 3.0} + (double)row + 0.5;
    D low = D{} - 1.0e300, high = D{} + 1.0e300;
    for (int k = 0; k < corners; ++k) {
      const auto& edge = edges.data[k];
      if (edge[3] == 0.0) continue;
      const D x = edge[0] + edge[2] * (y - edge[1]);
      if (edge[3] > 0.0) high = x < high ? x : high; else low = x > low ? x : low;
    }
    const D begin = __builtin_elementwise_ceil(low - 0.5), end = __builtin_elementwise_floor(high - 0.5) + 1.0;
    for (int k = 0; k < 4 && row + k <= last; ++k) {
      const bool is_open = low[k] < -1.0e299 || high[k] > 1.0e299;
      spans.of[row + k - first] = is_open ? Span{0, 0} : Span{(int)begin[k], (int)end[k]};
    }
  }
};
auto last_of_tiles = [&](int row) -> int { const int last = (row & ~(CELLS - 1)) + CELLS - 1; return last < last_row ? last : last_row; };
auto slot_of = [&](int i, int j) -> int {  // of page (i, j), -1 where none is
  const int x = i - land.table_x, y = j - land.table_y;
  return x < 0 || y < 0 || x >= table_nx || y >= table_ny ? -1 : land.table.data[y * table_nx + x];
};
auto number_of = [&](int count, int i, int j) -> int {  // of page (i, j) in the list of those of this cut, -1: not there
  for (int n = 0; n < count; ++n) if (page_rows[4 * n] == i && page_rows[4 * n + 1] == j) return n;
  return -1;
};

// ---- The pages of the cut: are all of them ready?
Spans spans;
int count = 0;
bool is_ready = true;
for (int row = first_row; row <= last_row; row = last_of_tiles(row) + 1) {
  const int last = last_of_tiles(row), j = row >> 9;
  find_spans(spans, row, last);
  int low = 0, high = -1;  // cells of the pages looked at last
  for (int r = row; r <= last; ++r) {
    const Span span = spans.of[r - row];
    if (span.first >= span.after || (span.first >= low && span.after - 1 <= high)) continue;
    for (int i = span.first >> 9; i <= (span.after - 1) >> 9; ++i) {
      if (number_of(count, i, j) < 0) {
        if (count == PAGES_MAX) { report.data[STATUS] = 3; return; }
        const int listed[4] = {i, j, 0, 0};
        __builtin_memcpy(page_rows + 4 * count, listed, sizeof listed);
        __builtin_memset(tile_marks + 64 * count, 0, 64);
        ++count;
      }
      const int slot = slot_of(i, j);  // in memory, and with codes of its own unless it is this low already?
      if (slot < 0 || (land.cut_slot.data[slot] < 0 && -1 - land.cut_slot.data[slot] > code)) is_ready = false;
    }
    low = (span.first >> 9) * PAGE, high = (((span.after - 1) >> 9) + 1) * PAGE - 1;
  }
}
report.data[PAGE_COUNT] = count;
report.data[STATUS] = is_ready ? 0 : 1;
if (!is_ready) return;

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
  unsigned char* codes;  // of its page, nullptr: none are higher
  double rank, scale, length;
};
auto look = [&](int tile_x, int tile_y) -> Tile {
  const int i = tile_x >> 3, j = tile_y >> 3, number = (tile_y & 7) * 8 + (tile_x & 7), slot = slot_of(i, j), line = land.cut_slot.data[slot];
  const auto& stand = land.tile_stand.data[64 * slot + number];
  const int prototype = land.tile_prototype.data[64 * slot + number];
  const int variant = ((prototype & 65535) * 4 + (prototype >> 16 & 3)) * (CELLS * CELLS);  // first cell of the prototype, mirrored as it is
  const double scale = stand[0], lean_x = stand[1], lean_y = stand[2];
  unsigned char* codes = line < 0 ? nullptr : land.cut.data + (long long)line * PAGE * PAGE;
  return {tile_x, number, number_of(count, i, j), variant, codes, stand[3], scale, __builtin_sqrt(scale * scale + lean_x * lean_x + lean_y * lean_y)};
};
Sum taken = {}, again = {};  // in all; by earlier cuts
int newly = 0, crop = 0, changed = 0;
for (int row = first_row; row <= last_row; row = last_of_tiles(row) + 1) {
  const int last = last_of_tiles(row);
  find_spans(spans, row, last);
  Tile tile;
  bool is_known = false;
  for (int r = row; r <= last; ++r) {
    const Span span = spans.of[r - row];
    for (int c = span.first; c < span.after;) {
      const int tile_x = c >> 6, end = (tile_x + 1) * CELLS, after = end < span.after ? end : span.after;
      if (!is_known || tile_x != tile.x) tile = look(tile_x, r >> 6), is_known = true;
      if (tile.codes) {
        unsigned char* codes = tile.codes + (r & 511) * PAGE + (tile_x & 7) * CELLS;  // of this row of the tile
        const int cell = tile.variant + (r & 63) * CELLS + (c & 63);
        for (int s = roots.first.data[cell]; s < roots.first.data[cell + after - c]; ++s) {
          const auto& at = roots.at.data[s];
          const int old = codes[at[1]];
          if (old <= code) continue;
          const auto& stem = roots.stems.data[at[0]];
          if (stem.rank >= tile.rank) continue;
          add(taken, stem, tile.scale, tile.length, code);
          if (old == STANDING) crop += (int)stem.crop; else add(again, stem, tile.scale, tile.length, old);
        }
        int lowered = 0;
#pragma clang loop vectorize(disable) unroll(disable)  // few cells
        for (int k = c & 63; k < (c & 63) + after - c; ++k) {
          const int old = codes[k];
          if (old <= code) continue;
          codes[k] = (unsigned char)code;
          ++lowered;
          newly += old == STANDING && tile.rank > 0.0;
        }
        changed += lowered;
        if (lowered) tile_marks[64 * tile.page + tile.number] = 1, page_rows[4 * tile.page + 3] = 1;
      }
      c = after;
    }
  }
}
masses.data[0] = wp::vec3d(taken.grain, taken.straw, taken.left);
masses.data[1] = wp::vec3d(again.grain, again.straw, again.left);
report.data[NEWLY_CUT] = newly;
report.data[CROP_STEMS] = crop;
report.data[CHANGED] = changed;
