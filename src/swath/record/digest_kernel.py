"""The bytes of the samples of an output, one after another: `digest.Columns` as a kernel."""

import warp as wp

wp.set_module_options({"enable_backward": False})

COPIED, DOUBLES, FLOATS, FLAGS, ALIKE = range(5)  # kinds of fields


@wp.func_native("""
const long long* j = (const long long*)job.data;
const char* row = (const char*)j[0];
char* to = (char*)j[2];
for (long long n = 0; n < j[4]; ++n, to += j[3]) {
  __builtin_memcpy(to, row, j[1]);
  const long long* field = j + 6;
  for (long long k = 0; k < j[5]; ++k, field += 5) {
    const char* from = (const char*)field[0] + n * field[1];
    char* at = to + field[2];
    const long long count = field[3];
    if (field[4] == 0) __builtin_memcpy(at, from, count);  // COPIED
    if (field[4] == 1)  // DOUBLES
      for (long long i = 0; i < count; ++i) {  // all NaNs are one
        unsigned long long x;
        __builtin_memcpy(&x, from + 8 * i, 8);
        x = (x & 0x7fffffffffffffffull) > 0x7ff0000000000000ull ? 0x7ff8000000000000ull : x;
        __builtin_memcpy(at + 8 * i, &x, 8);
      }
    if (field[4] == 2)  // FLOATS
      for (long long i = 0; i < count; ++i) {
        unsigned x;
        __builtin_memcpy(&x, from + 4 * i, 4);
        x = (x & 0x7fffffffu) > 0x7f800000u ? 0x7fc00000u : x;
        __builtin_memcpy(at + 4 * i, &x, 4);
      }
    if (field[4] == 3)  // FLAGS
      for (long long i = 0; i < count; ++i) at[i] = from[i] ? 't' : 'f';
    if (field[4] == 4) __builtin_memcpy(at, field, 8);  // ALIKE
  }
}
""")
def put_rows(job: wp.array(dtype=wp.int64)): ...


@wp.kernel
def lay_rows(job: wp.array(dtype=wp.int64)):
    """job: address and length of the bytes that are alike, address of the first row, bytes to the next, rows,
    fields; of each field: address in the first sample (`ALIKE`: the number itself), bytes to the next,
    place in the row, how many (bytes where `COPIED`), kind.
    """
    put_rows(job)
