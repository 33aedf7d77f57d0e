// Which pages beams can get to: the body of one native function (sight_kernel.py). Page after page along each beam, as far as
// all that belongs to it may still be above the ground.
//
// In: `whole`: addresses of the window table, of the lowest ground of each slot, of origins and directions, of the pages found
// missing, of the marks of slots seen, of the counters of the pages (`memory_layout.REVISION`), of origins and directions that were
// walked along last; nx, ny, table_x, table_y, beams, room for missing pages, slots, most beams; in and out: pages that had left
// memory then; out: how many pages are missing, walks. `real`: side of a tile [m], cos and sin of the stand's yaw, range [m], half a
// spot's width at the start [m] and per metre, where beams are too far away [m], how far they may be from those of the last walk
// [m, rad] with all its pages still in memory: then there is no need for another one.

const int* table = (const int*)whole.data[0];
const float* lowest = (const float*)whole.data[1];
const double *origins = (const double*)whole.data[2], *directions = (const double*)whole.data[3];
long long* missing = (long long*)whole.data[4];
unsigned char* seen = (unsigned char*)whole.data[5];
const long long* counters = (const long long*)whole.data[6];
double* covered = (double*)whole.data[7];
const long long nx = whole.data[8], ny = whole.data[9], x0 = whole.data[10], y0 = whole.data[11], beams = whole.data[12];
const long long room = whole.data[13], stems = counters[3];
const double tile = real.data[0], c = real.data[1], s = real.data[2], range = real.data[3], width = real.data[4], spread = real.data[5];

const double* middle = origins + 3 * (beams / 2);
whole.data[17] = 0;
if (beams == 0) return;
if (beams > whole.data[15] || !(__builtin_fabs(middle[0]) < real.data[6] && __builtin_fabs(middle[1]) < real.data[6])) {
  whole.data[17] = -1;
  return;
}
bool is_near = whole.data[16] == counters[2];
for (long long k = 0; k < 3 * beams && is_near; ++k)
  is_near = __builtin_fabs(origins[k] - covered[k]) <= real.data[7] && __builtin_fabs(directions[k] - covered[3 * beams + k]) <= real.data[8];
if (is_near) return;
++whole.data[18];
__builtin_memset(seen, 0, whole.data[14]);

constexpr double NEVER = 1.0e30;
const double side = 8.0 * tile, per_tile = 1.0 / tile;
long long count = 0;

auto floor_of = [](double v) -> long long { return (long long)__builtin_floor(v); };
auto slot_of = [&](long long i, long long j) -> int {
  if (i < x0 || j < y0 || i >= x0 + nx || j >= y0 + ny) return -1;
  return table[(j - y0) * nx + i - x0];
};
auto miss = [&](long long i, long long j) {
  for (long long k = count - 1; k >= 0; --k) if (missing[2 * k] == i && missing[2 * k + 1] == j) return;
  if (count < room) missing[2 * count] = i, missing[2 * count + 1] = j, ++count;
};
auto page_of = [&](double place, long long more) -> long long {  // the page of the tile `more` tiles beyond that of a place
  return (floor_of(place * per_tile) + more) >> 3;
};

for (long long n = 0; n < beams; ++n) {
  const double *o = origins + 3 * n, *d = directions + 3 * n;
  const double ox = c * o[0] + s * o[1], oy = c * o[1] - s * o[0], oz = o[2] + width;
  const double dx = c * d[0] + s * d[1], dy = c * d[1] - s * d[0], dz = d[2] + spread;
  const double per_x = __builtin_fabs(dx) > 1.0e-12 ? 1.0 / dx : 0.0, per_y = __builtin_fabs(dy) > 1.0e-12 ? 1.0 / dy : 0.0;
  if (!(__builtin_fabs(ox) + __builtin_fabs(oy) < 4.0e6)) continue;  // refused where it is cast
  long long i = page_of(ox, 0), j = page_of(oy, 0);
  double t = 0.0;
  while (t < range) {
    const int slot = slot_of(i, j);
    if (slot < 0) { miss(i, j); break; }
    seen[slot] = 1;
    const double tx = per_x == 0.0 ? NEVER : ((i + (dx > 0.0)) * side - ox) * per_x;
    const double ty = per_y == 0.0 ? NEVER : ((j + (dy > 0.0)) * side - oy) * per_y;
    double end = tx < ty ? tx : ty;
    end = end < range ? end : range;
    end = end > t ? end : t;
    double low = lowest[slot], to = end;
    for (bool again = true; again;) {
      again = false;
      const double under = dz < 0.0 ? (low - oz) / dz : NEVER;  // from there on all of the beam is below the ground
      to = under < end ? (under > t ? under : t) : end;
      const double w = width + spread * to, ax = ox + dx * t, bx = ox + dx * to, ay = oy + dy * t, by = oy + dy * to;
      const long long i0 = page_of((ax < bx ? ax : bx) - w, -stems), i1 = page_of((ax < bx ? bx : ax) + w, stems);
      const long long j0 = page_of((ay < by ? ay : by) - w, -stems), j1 = page_of((ay < by ? by : ay) + w, stems);
      for (long long b = j0; b <= j1; ++b)
        for (long long a = i0; a <= i1; ++a) {
          const int other = slot_of(a, b);
          if (other < 0) { miss(a, b); continue; }
          seen[other] = 1;
          if (lowest[other] < low) low = lowest[other], again = true;
        }
    }
    if (to < end) break;
    if (tx < ty) i += dx > 0.0 ? 1 : -1; else j += dy > 0.0 ? 1 : -1;
    t = end;
  }
}
whole.data[17] = count;
if (count == 0) {
  __builtin_memcpy(covered, origins, 24 * beams);
  __builtin_memcpy(covered + 3 * beams, directions, 24 * beams);
  whole.data[16] = counters[2];
}
