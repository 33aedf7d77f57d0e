// Which segments of others sweep ground of each segment of a path: outlines that are convex touch unless a side of one
// separates them (convex.cpp). The body of a native function; its arrays are those of table.py.
//
// numbers: segments of the path, rectangles of each, segments of the table, segments of a block, the machine that is
// left out, most pairs that there is room for; out: pairs found, all counted, those there is room for written

const double* m = (const double*)its.numbers.data;
const double *own = (const double*)its.own_points.data, *own_box = (const double*)its.own_boxes.data;
const double *other = (const double*)its.points.data, *box = (const double*)its.boxes.data, *block = (const double*)its.blocks.data;
const int *own_start = (const int*)its.own_starts.data, *start = (const int*)its.starts.data;
const int *first = (const int*)its.first_outline.data, *machine = (const int*)its.machines.data;
int* out = (int*)its.found.data;
const int rows = (int)m[0], rects = (int)m[1], count = (int)m[2], size = (int)m[3], but = (int)m[4], most = (int)m[5];
auto touch = [&](int i, int j) {
  for (int r = i * rects; r < (i + 1) * rects; ++r)
    for (int s = first[j]; s < first[j + 1]; ++s) {
      const double *a = own + 2 * own_start[r], *b = other + 2 * start[s];
      const int n = own_start[r + 1] - own_start[r], k = start[s + 1] - start[s];
      if (!separates(a, n, b, k) && !separates(b, k, a, n)) return true;
    }
  return false;
};
int pairs = 0;
for (int i = 0; i < rows; ++i)
  for (int b = 0; b * size < count; ++b) {
    if (apart(own_box + 4 * i, block + 4 * b)) continue;
    for (int j = b * size; j < count && j < (b + 1) * size; ++j) {
      if (machine[j] == but || apart(own_box + 4 * i, box + 4 * j) || !touch(i, j)) continue;
      if (pairs < most) { out[2 * pairs + 1] = i; out[2 * pairs + 2] = j; }
      ++pairs;
    }
  }
out[0] = pairs;
