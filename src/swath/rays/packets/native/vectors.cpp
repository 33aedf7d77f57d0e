// Ray packet traversal: the body of one native function (kernel.py), explained in docs/explanation/lidar.md in the same words.
//
// In: scene, index, and job_bytes, a Job. Each thread takes the next group until none is left (`run`, below).
//
// 16 lanes are computed at once by vector types of the compiler; whatever the machine has, the values are the
// same. No lane looks at another one: what else is in the group decides what is looked at, never a result.
// Lengths are metres. Frames: stand (from the corner of the first ray's tile), prototype, and group: e[0] mean
// direction, e[1] along the fan, e[2]; "slope" = place across over depth w along e[0], seen from the apex.

typedef float F __attribute__((vector_size(64)));
typedef int I __attribute__((vector_size(64)));
typedef double D __attribute__((vector_size(64)));  // half of the lanes
typedef float F8 __attribute__((vector_size(32)));
typedef short S __attribute__((vector_size(32)));
typedef short S4 __attribute__((vector_size(64)));
typedef unsigned char U __attribute__((vector_size(64)));
typedef unsigned long long W8 __attribute__((vector_size(64)));
typedef bool B __attribute__((ext_vector_type(16)));
typedef decltype(scene)& SceneRef;
typedef decltype(index)& IndexRef;
#define HOT __attribute__((always_inline))
constexpr int N = 16;            // lanes of a vector
constexpr int ROOM = 1024;       // lanes of a group
constexpr int VECTORS = ROOM / N, PACKETS = VECTORS;  // packets of a group at most
constexpr int SUBS = 512;        // sub-rays of a bundle at most
constexpr int PAIRS = 4096;      // pieces and vectors that wait
constexpr float UPRIGHT = 3.0f;  // vectors are so much higher than wide, as stems stand
constexpr int STEPS = 256;       // of places of vectors in slopes
constexpr int FIELDS = 8;        // of a kept piece
constexpr int KEPT = 2048;       // pieces that wait for their test
constexpr int COMING = 16;       // runs of pieces that are fetched ahead
constexpr int FLUSH = 8;         // so many are enough for a test
constexpr int BINS = 4;          // of a slab of columns that lies flat
constexpr int AROUND = 8;        // columns of a tile, in one direction
constexpr int SPAN = 2048;       // columns side by side that a traversal through one tile may touch
constexpr float FAR = 1.0e30f;
constexpr float NARROW = 0.03f;  // 1 - cos of the widest angle in a group, about 14 deg
constexpr float SPREAD = 1.0f;   // widest distance between origins in a group, of parallel rays across them
constexpr float DEEP = 8.0f;     // and along them
constexpr float ROUND = 2.0e-5f; // of places, covers float32
constexpr float SEAM = 1.0e-5f; // as far over the sides of the prototype its copies are the same, covers float32
constexpr int STANDING = 255, CUT = 1 << 30;
constexpr int INVALID = 1, LOW = 2;  // flags: rays that are none; rays that start low or where nothing is known


struct Vectors {  // vectors and small sums
  static F load(const float* p) { F v; __builtin_memcpy(&v, p, 64); return v; }
  static I loadi(const int* p) { I v; __builtin_memcpy(&v, p, 64); return v; }
  static void store(float* p, F v) { __builtin_memcpy(p, &v, 64); }
  static void storei(int* p, I v) { __builtin_memcpy(p, &v, 64); }
  static F put(float x) { return F{} + x; }
  static I puti(int x) { return I{} + x; }
  static I every() { return I{0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15}; }
  static F least(F a, F b) { return a < b ? a : b; }
  static F most(F a, F b) { return a > b ? a : b; }
  static F size_of(F a) { return __builtin_elementwise_abs(a); }
  static F root(F a) { return __builtin_elementwise_sqrt(a); }
  static float lowest_of(F a) {  // of all lanes; the compiler's own minds nan and takes three times as long
    a = least(a, __builtin_shufflevector(a, a, 8, 9, 10, 11, 12, 13, 14, 15, 0, 1, 2, 3, 4, 5, 6, 7));
    a = least(a, __builtin_shufflevector(a, a, 4, 5, 6, 7, 0, 1, 2, 3, 4, 5, 6, 7, 0, 1, 2, 3));
    a = least(a, __builtin_shufflevector(a, a, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1));
    return least(a, __builtin_shufflevector(a, a, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0))[0];
  }
  static float highest_of(F a) { return -lowest_of(-a); }
  static unsigned bits(I m) {
    B b = __builtin_convertvector(m < 0, B);
    unsigned short u;
    __builtin_memcpy(&u, &b, 2);
    return u;
  }
  static int count(I m) { return __builtin_popcount(bits(m)); }
  HOT static void keep_some(const F (&field)[FIELDS], float* const (&to)[FIELDS], unsigned found) {  // the found lanes, one after the other
#ifdef __AVX512F__
    for (int i = 0; i < FIELDS; ++i) {
      F packed = __builtin_ia32_compresssf512_mask(field[i], F{}, (unsigned short)found);
      __builtin_memcpy(to[i], &packed, 64);
    }
#else
    alignas(64) float lane[FIELDS][N];
    __builtin_memcpy(lane, field, sizeof lane);
    for (int n = 0; found; ++n, found &= found - 1)
      for (int i = 0; i < FIELDS; ++i) to[i][n] = lane[i][__builtin_ctz(found)];
#endif
  }
  static F as_float(I v) { F f; __builtin_memcpy(&f, &v, 64); return f; }  // the same bits
  static float lower(float a, float b) { return a < b ? a : b; }
  static float upper(float a, float b) { return a > b ? a : b; }
  static int down(float x) { return (int)__builtin_floorf(x); }
  static int per(int a, int b) { int q = a / b; return a - q * b < 0 ? q - 1 : q; }
  static float dot3(const float* a, const float* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
  static float unit(float* v) {
    float n = __builtin_sqrtf(dot3(v, v));
    for (int i = 0; i < 3; ++i) v[i] /= n > 1e-20f ? n : 1.0f;
    return n;
  }
};

