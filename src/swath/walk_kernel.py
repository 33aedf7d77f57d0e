"""The walk through a program of launches (`core/ops.py`), in compiled code."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.func_native("""
typedef long long number;
const number* lines = (const number*)program.data;
number* ops = (number*)steps.data;  // of each PLACE, BEGIN, END, SINCE, DUE, WHOLE, REST, MORE, OF
// UNTIL, BEFORE, OP, FROM, NEEDS, STAGE, REACHED, AT, NEXT, COUNT, CLOCK, ORDER
number* s = (number*)state.data;
number* now = (number*)s[10];
number* order = (number*)s[11];
number k = s[2];
s[4] = -1;
for (;; k = -1) {
  if (k < 0) {  // the earliest that is due, of several the first in declared order
    k = 0;
    for (number j = 1; j < s[9]; ++j)
      if (ops[9 * j + 4] < ops[9 * k + 4]) k = j;
    s[8] = ops[9 * k + 4];
    if (s[8] > s[0] || (s[8] == s[0] && ops[9 * k] >= s[1])) break;
    s[7] = s[8];
    s[3] = ops[9 * k + 1];
  }
  number* op = ops + 9 * k;
  const number t = op[4];
  for (number j = s[3]; j < op[2]; ++j) {
    const number* line = lines + 5 * j;
    if (line[0] == 0) {  // CALL: function, bounds, arguments, about
      now[0] = op[3];
      now[1] = t;
      now[2] = t - op[3];
      const number begun = __builtin_readcyclecounter();
      ((void (*)(void*, void*))line[1])((void*)line[2], (void*)line[3]);
      ((number*)line[4])[1] += __builtin_readcyclecounter() - begun;
    } else if (line[0] == 1) {  // NEED: flag, which op, stage
      if (*(const int*)line[1]) {
        s[2] = k;
        s[3] = j + 1;
        s[4] = line[2];
        s[5] = line[3];
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
      const number n = head[1]++;
      __builtin_memcpy((char*)head[0] + n * line[3], (const char*)line[2], line[3]);
      ((number*)head[3])[n] = t;
      ((number*)head[4])[n] = *(const number*)line[4];
      ((number*)head[5])[n] = *order;
    } else if (line[0] == 6) {  // REACH: number, bytes to the next world, worlds, what is enough
      for (number w = 0; w < line[3]; ++w)
        if (*(const double*)((const char*)line[1] + w * line[2]) >= ((const double*)line[4])[w]) s[6] = 1;
    }
  }
  op[3] = t;
  op[4] += op[5];
  op[6] += op[7];
  if (op[6] >= op[8]) {
    op[6] -= op[8];
    ++op[4];
  }
  if (s[6] && t < s[0]) {  // a goal is reached: no farther than to the end of the tick
    s[0] = t + 1;
    s[1] = 0;
  }
}
s[2] = -1;
""")
def walk_on(
    program: wp.array(dtype=wp.int64),
    steps: wp.array(dtype=wp.int64),
    state: wp.array(dtype=wp.int64),
): ...


@wp.kernel
def walk(
    program: wp.array(dtype=wp.int64),
    steps: wp.array(dtype=wp.int64),
    state: wp.array(dtype=wp.int64),
):
    """Walk lines by the times at which steps are due; see `core.ops`."""
    walk_on(program, steps, state)


@wp.kernel
def ask(needs: wp.array(dtype=wp.int32)):
    """Have Python do all of a step."""
    needs[0] = 1
