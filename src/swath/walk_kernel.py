"""The walk through a program of launches (`core/ops.py`), in compiled code."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.func_native("""
typedef long long number;
const number* lines = (const number*)program.data;
const number* part_of = (const number*)parts.data;
const number* tick_of = (const number*)ticks.data;
number* s = (number*)state.data;  // FIRST, LAST, BASE, PART, FROM, STOP, NEEDS, STAGE, REACHED, CLOCK, ORDER
number* now = (number*)s[9];
number* order = (number*)s[10];
number tick = s[0], part = s[3], from = s[4];
s[6] = -1;
for (; tick < s[1]; ++tick) {
  const number t = s[2] + tick_of[3 * tick];
  if (part < 0) part = tick_of[3 * tick + 1];
  const number end = tick == s[1] - 1 && s[5] >= 0 ? s[5] : tick_of[3 * tick + 2];
  for (; part < end; ++part, from = -1) {
    for (number j = from < 0 ? part_of[2 * part] : from; j < part_of[2 * part + 1]; ++j) {
      const number* line = lines + 6 * j;
      if (line[0] == 0) {  // CALL: function, bounds, arguments, period, about
        now[0] = t - line[4];
        now[1] = t;
        now[2] = line[4];
        const number begun = __builtin_readcyclecounter();
        ((void (*)(void*, void*))line[1])((void*)line[2], (void*)line[3]);
        ((number*)line[5])[1] += __builtin_readcyclecounter() - begun;
      } else if (line[0] == 1) {  // NEED: flag, slot, stage
        if (*(const int*)line[1]) {
          s[0] = tick;
          s[3] = part;
          s[4] = j + 1;
          s[6] = line[2];
          s[7] = line[3];
          return;
        }
      } else if (line[0] == 2) {  // CLEAR: head of a trail
        ((number*)line[1])[1] = 0;
      } else if (line[0] == 3) {  // SEND: about
        ++*order;
        ++((number*)line[1])[0];
      } else if (line[0] == 4) {  // STAMP: where
        *(number*)line[1] = t;
      } else if (line[0] == 5) {  // KEEP: head of the trail, sample, its bytes, its stamp
        number* head = (number*)line[1];
        const number k = head[1]++;
        __builtin_memcpy((char*)head[0] + k * line[3], (const char*)line[2], line[3]);
        ((number*)head[3])[k] = t;
        ((number*)head[4])[k] = *(const number*)line[4];
        ((number*)head[5])[k] = *order;
      } else if (line[0] == 6) {  // REACH: number, bytes to the next world, worlds, what is enough
        for (number w = 0; w < line[3]; ++w)
          if (*(const double*)((const char*)line[1] + w * line[2]) >= ((const double*)line[4])[w]) s[8] = 1;
      }
    }
  }
  part = -1;
  if (s[8]) {
    ++tick;
    break;
  }
}
s[0] = tick;
s[3] = s[4] = -1;
""")
def walk_on(
    program: wp.array(dtype=wp.int64),
    parts: wp.array(dtype=wp.int64),
    ticks: wp.array(dtype=wp.int64),
    state: wp.array(dtype=wp.int64),
): ...


@wp.kernel
def walk(
    program: wp.array(dtype=wp.int64),
    parts: wp.array(dtype=wp.int64),
    ticks: wp.array(dtype=wp.int64),
    state: wp.array(dtype=wp.int64),
):
    """Walk lines, (first, end) lines of each part, (time, first, end) parts of each tick.

    state: see `core.ops`
    """
    walk_on(program, parts, ticks, state)


@wp.kernel
def ask(needs: wp.array(dtype=wp.int32)):
    """Have Python do all of a step."""
    needs[0] = 1
