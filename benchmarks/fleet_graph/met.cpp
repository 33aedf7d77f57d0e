// Which resources sweep the same ground: outlines that are convex touch unless a side of one separates them (convex.cpp). The body of a
// native function; its arrays are those of kernel.py.
//
// numbers: resources, most pairs that there is room for; of each resource, in order of west: its box and its first outline
// (count + 1); out: pairs found, all counted, those there is room for written

const double* m = (const double*)its.numbers.data;
const double *point = (const double*)its.points.data, *box = (const double*)its.boxes.data, *part = (const double*)its.parts.data;
const int *start = (const int*)its.starts.data, *first = (const int*)its.first.data;
int* out = (int*)its.found.data;
const int count = (int)m[0], most = (int)m[1];
auto touch = [&](int i, int j) {
  for (int r = first[i]; r < first[i + 1]; ++r) {
    if (apart(part + 4 * r, box + 4 * j)) continue;
    const double* a = point + 2 * start[r];
    const int n = start[r + 1] - start[r];
    for (int s = first[j]; s < first[j + 1]; ++s) {
      if (apart(part + 4 * r, part + 4 * s)) continue;
      const double* b = point + 2 * start[s];
      const int k = start[s + 1] - start[s];
      if (!separates(a, n, b, k) && !separates(b, k, a, n)) return true;
    }
  }
  return false;
};
int pairs = 0;
for (int i = 0; i < count; ++i)
  for (int j = i + 1; j < count && box[4 * j] <= box[4 * i + 2]; ++j) {
    if (apart(box + 4 * i, box + 4 * j) || !touch(i, j)) continue;
    if (pairs < most) { out[2 * pairs + 1] = i; out[2 * pairs + 2] = j; }
    ++pairs;
  }
out[0] = pairs;
