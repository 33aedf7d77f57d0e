"""The bytes of the samples of outputs, one after another: `digest.Columns` as a kernel."""

import warp as wp

wp.set_module_options({"enable_backward": False})

COPIED, DOUBLES, FLOATS, FLAGS = range(4)  # kinds of fields


@wp.func_native("""
for (const long long* j = (const long long*)first.data[0]; j; j = (const long long*)j[0]) {
  const long long* head = j + 4;
  const long long* alike = head + 6;
  char* to = (char*)j[1];
  for (long long w = j[2]; w < j[3]; ++w)
  for (long long n = 0; n < head[1]; ++n, to += alike[1]) {
    __builtin_memcpy(to, (const char*)alike[0], alike[1]);
    const long long* field = alike + 3;
    for (long long k = 0; k < alike[2]; ++k, field += 7) {
      const char* from = (const char*)head[field[5]] + field[6] + n * field[0] + w * field[1];
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
    }
  }
}
""")
def put_rows(first: wp.array(dtype=wp.int64)): ...


@wp.kernel
def lay_rows(first: wp.array(dtype=wp.int64)):
    """first: address of the first job, each: address of the next one, 0 = none; that of the first row; worlds
    from, to; the head of a trail (`core/rows.py`); address and length of the bytes that are alike; fields; of
    each field: bytes to that of the next sample and world, place in the row, how many (bytes where `COPIED`),
    kind, which address of the head it is at, and how many bytes behind that.
    """
    put_rows(first)
