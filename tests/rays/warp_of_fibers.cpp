// 32 lanes of a card's warp as fibers of one thread, for tests: each runs to the next barrier, then the next one, in an order
// that changes every time. What lanes exchange goes through `slot`. Lanes that wait at different things are an error.
#include <ucontext.h>

#include <vector>

namespace {
constexpr int LANES = 32, STACK = 1 << 18;
ucontext_t home, fiber[LANES];
std::vector<char> stacks(LANES* STACK);
int now = 0, waits_at[LANES], turn = 0;
unsigned slot[LANES];
void (*body)(void*) = nullptr;
void* with = nullptr;

void enter() {
  body(with);
  waits_at[now] = -1;  // done
  swapcontext(&fiber[now], &home);
}
}  // namespace

extern "C" {
int faults = 0;  // lanes that were elsewhere than the others
long long barriers = 0;

void run_lanes(void (*work)(void*), void* data) {
  body = work;
  with = data;
  for (int i = 0; i < LANES; ++i) {
    getcontext(&fiber[i]);
    fiber[i].uc_stack.ss_sp = stacks.data() + i * STACK;
    fiber[i].uc_stack.ss_size = STACK;
    fiber[i].uc_link = &home;
    makecontext(&fiber[i], enter, 0);
    waits_at[i] = 0;
  }
  for (;;) {
    ++turn;
    ++barriers;
    for (int i = 0; i < LANES; ++i) {
      now = (i * (2 * (turn * 5 % 16) + 1) + turn) % LANES;
      swapcontext(&home, &fiber[now]);
    }
    for (int i = 1; i < LANES; ++i)
      if (waits_at[i] != waits_at[0]) {
        ++faults;
        return;
      }
    if (waits_at[0] == -1) return;
  }
}

int lane_now() { return now; }

void wait_for_all(int at) {
  waits_at[now] = at;
  swapcontext(&fiber[now], &home);
}

unsigned from_lane(unsigned mine, int lane) {
  slot[now] = mine;
  wait_for_all(1);
  const unsigned theirs = slot[lane & (LANES - 1)];
  wait_for_all(2);
  return theirs;
}

unsigned ballot(unsigned mine) {
  slot[now] = mine != 0;
  wait_for_all(3);
  unsigned all = 0;
  for (int i = 0; i < LANES; ++i) all |= slot[i] << i;
  wait_for_all(4);
  return all;
}
}
