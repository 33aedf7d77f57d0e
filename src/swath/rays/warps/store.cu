// ---- What a group holds, and what is known of it by all lanes
//
// A slot holds one ray, 16 slots side by side are a slice. Lengths are metres, "t" is the way along a ray. Frames: stand
// (from the corner of the first ray's tile), prototype, and group: e0 mean direction, e1 along the fan, e2; "slope" =
// place across over depth along e0, seen from the apex.

typedef wp::vec_t<3, wp::float32> V;
constexpr int N = 16;             // slots of a slice
constexpr int ROOM = 384;         // slots of a group
constexpr int SLICES = ROOM / N;
constexpr int RUNS = 64;          // runs of pieces that wait
constexpr int KEPT = 64;          // pieces that wait, in a ring
constexpr int CANDIDATES = WARP * N + WARP;  // pieces and rays that wait for the exact test: all of 32 pairs, and a rest
constexpr int RECORD = 5;         // four numbers each that are kept of a ray in the card's large memory
constexpr int STANDING = 255, NOWHERE = 0x7fffffff;
constexpr float NARROW = 0.03f;   // 1 - cos of the widest angle in a group, about 14 deg
constexpr float SPREAD = 1.0f;    // widest distance between origins in a group
constexpr float ROUND = 2.0e-5f;  // of places, covers float32
constexpr int SPAN = 2048;        // columns side by side that a way through one tile may touch
constexpr int MANY = 128;         // so many pieces are worth gathering
static_assert(SLICES <= WARP && ROOM <= 512 && KEPT <= 128, "one lane for each slice; packed numbers");

constexpr int HIT = 1, HERE = 2;

struct alignas(16) Four { float x, y, z, w; };
struct alignas(8) Two { float x, y; };
// A tile: number from the group's; page, slot of that in memory, place in it; plane z = plane0 + plane1 x + plane2 y around its
// middle; stand
struct Tile {
  int x, y, page_x, page_y, slot, jx, jy, cut_row, prototype;
  float plane0, plane1, plane2, height, lean_x, lean_y, share, squeeze;
  bool mirror_x, mirror_y;
};
struct alignas(16) Store {
  Two spot[ROOM];                // slope u, v
  unsigned long long key[ROOM];  // nearest in the tile at hand: distance, then number of the primitive; `key_of`
  float t[ROOM];                 // nearest so far; -1: no ray
  unsigned char state[ROOM];     // HIT: something; HERE: may do so in the tile at hand
  // Of a slice. Slopes: middle u, v, half size u, v; the same of the offsets of origins
  Four box[SLICES], shift[SLICES];
  Four rest[SLICES];             // disc around the middle of slopes, of offsets; t that counts in the tile, at all
  float cap[SLICES];             // t that the needed hits of its bundle do not exceed
  float leave[SLICES];           // t of the last that leaves the tile
  float oa0[SLICES], oa1[SLICES], da0[SLICES], da1[SLICES];  // places and directions along the rows of tiles,
  float ob0[SLICES], ob1[SLICES], db0[SLICES], db1[SLICES];  // across
  float oz0[SLICES], dz0[SLICES];                            // and up
  float row_t0[SLICES], row_t1[SLICES], row_b0[SLICES], row_b1[SLICES], row_z0[SLICES];
  // through the tile at hand: first, last along the walk's axis; bounds from `from` on: across low and high, other axis
  // low and high, least t
  float a0[SLICES], a1[SLICES], from[SLICES], bound[5][SLICES], rise[5][SLICES];
  int side0[SLICES], side1[SLICES];
  float c0[SLICES], c1[SLICES];
  Four piece[KEPT], more[KEPT];  // u, v, direction; half length, half width, 1 / depth, least t
  int prim[KEPT], piece_copy[KEPT];
  unsigned short pair[WARP * SLICES];  // piece * 32 + slice: room for all of a batch. Before: see `codes`
  unsigned short candidate[CANDIDATES];  // piece * 512 + slot
  unsigned long long tried[WARP];
  unsigned char is_new[WARP];
  int run_first[RUNS], run_at[RUNS], run_copy[RUNS];
  float apex[3], e0[3], e1[3], e2[3];  // frame of the group
  Four m[3];                     // from the prototype, in steps, into that frame: depth, u, v = m x + w
  float lift;                    // height of the tile's plane above the group's
  Tile tile;
  float tallest[64];             // of what is left in the columns of the tile
};
static_assert(__is_trivially_constructible(Store), "as shared memory has to be");
SHARED Store s;
#if !defined(__CUDA_ARCH__)
__builtin_memset(&s, order % 2 ? 0xff : 0x7f, sizeof s);  // nan, or huge: nothing is read before it is written
#endif
unsigned char* const codes = (unsigned char*)s.pair;  // highest cut code of the 16 x 16 columns around

auto four = [&](const void* p) -> Four {
#if defined(__CUDA_ARCH__)
  return *(const Four*)p;
#else
  Four f;
  __builtin_memcpy(&f, p, 16);
  return f;
#endif
};
// Distances in the order of whole numbers, then the number of what was hit; 0 = the limit, nothing hit
auto key_of = [&](float t, int number) {
  const int i = bits_of(t);
  const unsigned high = i < 0 ? ~(unsigned)i : (unsigned)i | 0x80000000u;
  return (unsigned long long)high << 32 | (unsigned)number;
};
auto key_t = [&](unsigned long long key) {
  const unsigned high = (unsigned)(key >> 32);
  return float_of((int)(high & 0x80000000u ? high & 0x7fffffffu : ~high));
};

auto vector = [&](const float* x) { return V(x[0], x[1], x[2]); };
auto keep_vector = [&](float* x, V v) { for (int i = 0; i < 3; ++i) x[i] = v[i]; };

// All lanes know these. Of the launch:
const int width = lanes.shape[1], bundle_slices = width / N;
const int* table = lanes.data;
const float size = (float)scene.tile_size;
const double dsize = scene.tile_size;
const float fine = 64.0f / size, tile_steps = size / index.step;  // cells of the cut per metre; steps of the index per tile
// of the group:
int begun = 0, packs = 0, count = 0, slice_count = 0, gx = 0, gy = 0, A = 0;
double gz = 0.0;
float sway_u = 0.0f, w_origin = 0.0f, w_rate = 0.0f;  // largest offset; depth at t is at most w_origin + w_rate t
// of the tile: which slices walk in its crop, and t that still counts there
const Tile& tile = s.tile;
unsigned walkers = 0;
float reach = 0.0f;

// What is kept of rays in the card's large memory, of one kind side by side. Its place is that of the group's first ray on,
// whatever part of the group is at hand.
const size_t first_slot = (size_t)(first_pack.data[g] - first_pack.data[first]) * width;
const int slots = (first_pack.data[g + 1] - first_pack.data[g]) * width;
Four* const ray_origin = (Four*)memory.data + first_slot * RECORD;  // stand frame; where its tile and height lie from the group's
Four* const ray_direction = ray_origin + slots;  // stand frame; which copy of the prototype it hit
Four* const ray_point = ray_direction + slots;   // prototype: where it is at `start`; way from there to where it enters
Four* const ray_ahead = ray_point + slots;       // prototype: unit direction; t per length
Four* const ray_way = ray_ahead + slots;         // t of start, tile entry and exit; length of the part in crop
// Copies of the prototype around it, by tiles in x and y
auto copy_at = [&](int x, int y) { return x * 65536 + y; };
auto copy_y = [&](int copy) { return (int)(short)(copy & 0xffff); };
auto copy_x = [&](int copy) { return (copy - (int)(short)(copy & 0xffff)) >> 16; };
auto copy_of = [&](int j) { return (int*)&ray_direction[j].w; };
auto cast_off = [&](float w, int axis) { return (float)(((bits_of(w) >> (8 * axis)) & 255) - 128); };
auto ray_of = [&](int j) { return table[(size_t)begun * width + j]; };
auto slot_of = [&](int page_x, int page_y) {
  const int i = page_x - scene.table_x, j = page_y - scene.table_y;
  if (i < 0 || j < 0 || i >= scene.table.shape[1] || j >= scene.table.shape[0]) return -1;
  return scene.table.data[j * scene.table.shape[1] + i];
};
auto out = [&](int j, float t, int what, float cosine_, float albedo) {
  const int i = ray_of(j);
  s.t[j] = t;
  s.state[j] |= HIT;
  distance.data[i] = t;
  organ.data[i] = (unsigned char)what;
  cosine.data[i] = cosine_;
  reflectance.data[i] = albedo;
};

// How far slices still look: in the tile, and at all; `fresh`: slices with new hits. Where only the nearest of a
// bundle are needed: no farther than those, at most a sixtieth of their spread
auto look = [&](unsigned fresh) {
  if (need > 0)
    for (unsigned left = fresh; left;) {
      const int p = lowest_bit(left) / bundle_slices, begin = p * width;
      for (int i = 0; i < bundle_slices; ++i) left &= ~(1u << (p * bundle_slices + i));
      float low = FAR, high = -FAR;
      int hits = 0;
      for (int base = 0; base < width; base += WARP) EACH_LANE {
        const int j = begin + base + lane;
        const bool is_hit = base + lane < width && s.state[j] & HIT;
        fold_low(low, is_hit ? s.t[j] : FAR);
        fold_high(high, is_hit ? s.t[j] : -FAR);
        fold_count(hits, is_hit);
      }
      if (hits < need) continue;
      for (int i = 0; i < (need == 1 ? 0 : 6) && hits > need; ++i) {
        const float middle = 0.5f * (low + high);
        int below = 0;
        for (int base = 0; base < width; base += WARP) EACH_LANE {
          const int j = begin + base + lane;
          fold_count(below, base + lane < width && s.state[j] & HIT && s.t[j] <= middle);
        }
        (below >= need ? high : low) = middle;
      }
      EACH_LANE if (lane / bundle_slices == p && lane < SLICES) s.cap[lane] = need == 1 ? low : high;
    }
  reach = -FAR;
  EACH_LANE {
    float in_tile = -FAR, at_all = -FAR;
    if (lane < slice_count) {
      for (int i = 0; i < N; ++i) {
        const int j = lane * N + ((i + lane) & (N - 1));  // not all in the same bank of the memory
        in_tile = upper(in_tile, s.state[j] & HERE ? s.t[j] : -FAR);
        at_all = upper(at_all, s.t[j]);
      }
      in_tile = lower(in_tile, lower(s.leave[lane], s.cap[lane]));
      s.rest[lane].z = in_tile;
      s.rest[lane].w = lower(at_all, s.cap[lane]);
    }
    fold_high(reach, walkers >> lane & 1 ? in_tile : -FAR);
  }
};
