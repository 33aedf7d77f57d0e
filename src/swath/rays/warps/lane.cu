// The group walk for a card: one warp of 32 lanes per group of neighbouring beams. The files lane, store, shapes, batch,
// pieces, columns, tile and walk follow each other in the body of one native function (kernel.py); docs/rays.md explains it.
//
// ---- A warp. On the card each lane is a thread; elsewhere the lanes run one after the other, in a sequence that `order`
// picks, so that the same text is tested without a card.
//
// `EACH_LANE { ... }` is a step, between two barriers. Within a step no lane reads what another one writes. Outside of
// steps all lanes do the same with the same numbers, and write to nothing that is shared. `fold_...` and `claim...`
// are for all lanes together: in a step, never under a condition.

constexpr int WARP = 32;
constexpr float FAR = 1.0e30f;

auto lower = [&](float a, float b) { return a < b ? a : b; };
auto upper = [&](float a, float b) { return a > b ? a : b; };
auto down = [&](float x) { return (int)::floorf(x); };
auto per = [&](int a, int b) { const int q = a / b; return a - q * b < 0 ? q - 1 : q; };

#if defined(__CUDA_ARCH__)
#define EACH_LANE for (int lane = (__syncwarp(), (int)(threadIdx.x & 31u)), open_ = 1; open_; open_ = 0, __syncwarp())
#define SHARED __shared__
constexpr unsigned EVERY = 0xffffffffu;
auto before_me = [&]() { return (1u << (threadIdx.x & 31u)) - 1u; };
auto fold_low = [&](float& all, float x) {
  for (int d = WARP / 2; d > 0; d /= 2) x = fminf(x, __shfl_xor_sync(EVERY, x, d));  // the same for all, nan or not
  all = fminf(all, x);
};
auto fold_high = [&](float& all, float x) {
  for (int d = WARP / 2; d > 0; d /= 2) x = fmaxf(x, __shfl_xor_sync(EVERY, x, d));
  all = fmaxf(all, x);
};
auto fold_least = [&](int& all, int x) {
  for (int d = WARP / 2; d > 0; d /= 2) { const int y = __shfl_xor_sync(EVERY, x, d); x = y < x ? y : x; }
  all = x < all ? x : all;
};
auto fold_bits = [&](unsigned& all, unsigned x) {
  for (int d = WARP / 2; d > 0; d /= 2) x |= __shfl_xor_sync(EVERY, x, d);
  all |= x;
};
auto fold_count = [&](int& all, bool is_one) { all += __popc(__ballot_sync(EVERY, is_one)); };
// A place in a list for each lane that wants one
auto claim = [&](int& count, bool wants) {
  const unsigned who = __ballot_sync(EVERY, wants);
  const int at = count + __popc(who & before_me());
  count += __popc(who);
  return at;
};
// `n` places side by side for each lane
auto claim_many = [&](int& count, int n) {
  int sum = n;
  for (int d = 1; d < WARP; d *= 2) {
    const int y = __shfl_up_sync(EVERY, sum, d);
    if ((int)(threadIdx.x & 31u) >= d) sum += y;
  }
  const int at = count + sum - n;
  count += __shfl_sync(EVERY, sum, WARP - 1);
  return at;
};
auto keep_least64 = [&](unsigned long long* at, unsigned long long x) { return atomicMin(at, x); };
auto keep_least = [&](int* at, int x) { atomicMin(at, x); };
auto lowest_bit = [&](unsigned x) { return __ffs(x) - 1; };
auto bit_count = [&](unsigned x) { return __popc(x); };
auto bits_of = [&](float x) { return __float_as_int(x); };
auto float_of = [&](int x) { return __int_as_float(x); };
auto about_inverse = [&](float x) { return __fdividef(1.0f, x); };  // for what decides only what is looked at
auto about_inverse_root = [&](float x) { return rsqrtf(x); };
#else
int step_ = 0;
auto lane_at = [&](int turn) {
  if (order == 0) return turn;
  if (order == 1) return WARP - 1 - turn;
  return (turn * (2 * ((7 * step_ + order) % 16) + 1) + step_) % WARP;
};
#define EACH_LANE for (int turn_ = (++step_, 0); turn_ < WARP; ++turn_) if (const int lane = lane_at(turn_); true)
#define SHARED
auto fold_low = [&](float& all, float x) { all = x < all ? x : all; };
auto fold_high = [&](float& all, float x) { all = x > all ? x : all; };
auto fold_least = [&](int& all, int x) { all = x < all ? x : all; };
auto fold_bits = [&](unsigned& all, unsigned x) { all |= x; };
auto fold_count = [&](int& all, bool is_one) { all += is_one; };
auto claim = [&](int& count, bool wants) { const int at = count; count += wants; return at; };
auto claim_many = [&](int& count, int n) { const int at = count; count += n; return at; };
auto keep_least64 = [&](unsigned long long* at, unsigned long long x) {
  const unsigned long long was = *at;
  *at = x < was ? x : was;
  return was;
};
auto keep_least = [&](int* at, int x) { *at = x < *at ? x : *at; };
auto lowest_bit = [&](unsigned x) { return __builtin_ctz(x); };
auto bit_count = [&](unsigned x) { return __builtin_popcount(x); };
auto bits_of = [&](float x) { int i; __builtin_memcpy(&i, &x, 4); return i; };
auto float_of = [&](int x) { float f; __builtin_memcpy(&f, &x, 4); return f; };
auto about_inverse = [&](float x) { return 1.0f / x; };
auto about_inverse_root = [&](float x) { return 1.0f / ::sqrtf(x); };
#endif
