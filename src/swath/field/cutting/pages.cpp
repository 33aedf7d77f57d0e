// Before the body of a native function: pages of a field as `Land` has them, and what it does with polygons (land_kernel.py).

constexpr int CELLS = 64, TILES = 8, PAGE = 512, STANDING = 255, PAGES_MAX = 256, CORNERS_MAX = 64;  // as in memory_layout.py, land.py
constexpr int REVISION = 0, MOVED = 1, STEM_REACH = 3, TOUCHED = 4, SUMS = 8, DONE = 6, LACKED = 7;
constexpr double FAR = 1.0e6;  // as in field.py
constexpr long long COUNTED = -2;  // as in land.py
struct Point { double x, y; };
struct Asked { double corners, first, second; Point at[1]; };
struct Used { int i, j, is_lower, is_cut; };  // of a page, as `PageStore.touched` has it
auto slot_at = [](const auto& land, int i, int j) -> int {  // of page (i, j), -1 where none is
  const int x = i - land.table_x, y = j - land.table_y, nx = land.table.shape[1];
  return x < 0 || y < 0 || x >= nx || y >= land.table.shape[0] ? -1 : land.table.data[y * nx + x];
};
auto has_room = [](const auto& land, int more) -> bool { return land.counters.data[TOUCHED] + more <= land.touched.shape[0]; };
auto touch = [](const auto& land, const Used& page) {  // notes that it was looked at, behind those before; each page once
  Used *rows = (Used*)land.touched.data, *kept = rows, found = page;
  for (Used* row = rows; row < rows + land.counters.data[TOUCHED]; ++row) {
    if (row->i == page.i && row->j == page.j) found.is_lower |= row->is_lower, found.is_cut |= row->is_cut;
    else *kept++ = *row;
  }
  *kept++ = found;
  land.counters.data[TOUCHED] = kept - rows;
};
// Of a world, its polygons one after the other. take: does one of them, with what it adds to `sums`; false: Python has to; is_counted:
// those of a field as a profile, too
auto each_polygon = [](int w, const auto& its, auto take, bool is_counted = false) {
  const auto& land = its.lands.data[w];
  double* sums = its.sums.data + SUMS * w;
  __builtin_memset(sums, 0, SUMS * sizeof *sums);
  for (; sums[DONE] < its.found.data[w]; sums[DONE] += 1.0) {
    const Asked* polygon = (const Asked*)(its.polygons.data + its.polygons.shape[2] * (its.polygons.shape[1] * (long long)w + (int)sums[DONE]));
    bool is_near = is_counted || (its.known.data[w] >= 0 && its.known.data[w] == land.counters.data[MOVED]);
    for (int k = 0; is_near && !is_counted && k < (int)polygon->corners; ++k)
      is_near = __builtin_fabs(polygon->at[k].x) <= FAR && __builtin_fabs(polygon->at[k].y) <= FAR;
    if (!is_near || !take(land, *polygon, sums)) { its.needs.data[0] = 1; return; }
  }
};
