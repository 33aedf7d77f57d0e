// What is gone from the stems of a page, counted anew from the codes of its cells: the body of one native function.
//
// In: `whole` addresses of arrays, as `recount_kernel.py` says; `real` side of a tile [m], exponent of straw.
// Out: `masses` (64, 4) grain, straw, grain left and stubble [kg]; `counts` (64, 4) 1 = a code differs, stems of the crop
// that no longer stand, cells that no longer stand, 0. Sums are those of exact numbers, rounded once.

constexpr int SIDE = 64, PAGE = 512, TILES = 8, STOOD = 255, MIRROR_X = 1 << 16, MIRROR_Y = 1 << 17;
const auto start = (const unsigned char*)whole.data[0];    // codes (512, 512)
const auto now = (const unsigned char*)whole.data[1];
const auto prototypes = (const int*)whole.data[2];         // (8, 8)
const auto stands = (const float*)whole.data[3];           // (8, 8, 4)
const auto begins = (const int*)whole.data[4];             // of the stems of each prototype
const auto places = (const float*)whole.data[5];           // (n, 2)
const auto ranks = (const float*)whole.data[6];
const auto heights = (const double*)whole.data[7];
const auto ears = (const double*)whole.data[8];
const auto grains = (const double*)whole.data[9];
const auto straws = (const double*)whole.data[10];
const auto is_crop = (const unsigned char*)whole.data[11];
const double tile_size = real.data[0], exponent = real.data[1], per_m = SIDE / tile_size;

struct Exact {  // a sum and what its rounding left out
  double sum, rest;
  void add(double term) {
    const double next = sum + term, part = next - sum;
    rest += (sum - (next - part)) + (term - part);
    sum = next;
  }
};
struct Masses { double grain, straw, left, stubble; };
auto cell_of = [&](double place, bool is_mirrored) -> int {
  const double cell = __builtin_floor((is_mirrored ? tile_size - place : place) * per_m);
  return cell < 0.0 ? 0 : cell > SIDE - 1.0 ? SIDE - 1 : (int)cell;
};
auto taken = [&](int stem, double scale, double length, int code) -> Masses {  // of a stem whose cell has this code
  if (code == STOOD) return {0.0, 0.0, 0.0, 0.0};
  const double height = 0.01 * code, share = 1.0 - height / (heights[stem] * scale);
  const double above = share < 0.0 ? 0.0 : share > 1.0 ? 1.0 : share;
  const bool is_high = ears[stem] * scale > height;
  const double whole = straws[stem] * length, straw = whole * wp::pow(above, exponent);
  return {is_high ? grains[stem] : 0.0, straw, is_high ? 0.0 : grains[stem], whole - straw};
};
for (int number = 0; number < TILES * TILES; ++number) {
  const int corner = (number / TILES) * SIDE * PAGE + (number % TILES) * SIDE;
  int* told = counts.data + 4 * number;
  told[0] = told[1] = told[2] = told[3] = 0;
  int gone = 0, changed = 0;
  for (int row = 0; row < SIDE; ++row) {
    const unsigned char *then = start + corner + row * PAGE, *after = now + corner + row * PAGE;
    for (int column = 0; column < SIDE; ++column) {
      changed |= then[column] ^ after[column];
      gone += (then[column] == STOOD) & (after[column] != STOOD);
    }
  }
  if (!changed) continue;
  const float* stand = stands + 4 * number;
  const double scale = stand[0], lean_x = stand[1], lean_y = stand[2], rank = stand[3];
  const double length = __builtin_sqrt(scale * scale + lean_x * lean_x + lean_y * lean_y);
  const int prototype = prototypes[number], kind = prototype & (MIRROR_X - 1);
  Exact grain = {}, straw = {}, left = {}, stubble = {};
  for (int stem = begins[kind]; stem < begins[kind + 1]; ++stem) {
    if (!(ranks[stem] < rank)) continue;
    const int column = cell_of(places[2 * stem], prototype & MIRROR_X), row = cell_of(places[2 * stem + 1], prototype & MIRROR_Y);
    const int then = start[corner + row * PAGE + column], after = now[corner + row * PAGE + column];
    if (then == after) continue;
    const Masses was = taken(stem, scale, length, then), is = taken(stem, scale, length, after);
    grain.add(is.grain - was.grain);
    straw.add(is.straw - was.straw);
    left.add(is.left - was.left);
    stubble.add(is.stubble - was.stubble);
    told[1] += then == STOOD && after != STOOD && is_crop[stem];
  }
  told[0] = 1;
  told[2] = gone;
  const Exact sums[4] = {grain, straw, left, stubble};
  for (int k = 0; k < 4; ++k) masses.data[4 * number + k] = sums[k].sum + sums[k].rest;
}
