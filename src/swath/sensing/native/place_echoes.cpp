// World points of echoes: the body of a native function (receive_kernel.py).
//
// In: `whole`: addresses of origins (n, 3), axes (n, 3, 3) and offsets (n or 1, s, 5) of `rays/hits.py`, of the hits' distances
// (n, s), of echoes (n, echoes) and their shares (n, echoes, s), of points (n, echoes, 3), which are written, nan = no echo; n, s,
// echoes, beams that have offsets of their own (n or 1).

typedef double D;
typedef long long L;
const D *origins = (const D*)whole.data[0], *axes = (const D*)whole.data[1], *offsets = (const D*)whole.data[2];
const D *hits = (const D*)whole.data[3], *far = (const D*)whole.data[4], *shares = (const D*)whole.data[5];
D* points = (D*)whole.data[6];
const L beams = whole.data[7], s = whole.data[8], echoes = whole.data[9], own = whole.data[10];

for (L b = 0; b < beams; ++b)
  for (L k = 0; k < echoes; ++k) {
    const D *share = shares + (b * echoes + k) * s, *at = origins + 3 * b, *axis = axes + 9 * b;
    D* point = points + 3 * (b * echoes + k);
    const D none = far[b * echoes + k] == far[b * echoes + k] ? 0.0 : __builtin_nan("");
    for (int i = 0; i < 3; ++i) point[i] = none;
    for (L j = 0; j < s; ++j) {
      if (share[j] == 0.0) continue;
      const D* o = offsets + 5 * ((own > 1 ? b * s : 0) + j);
      for (int i = 0; i < 3; ++i) {
        const D forward = axis[3 * i], across = axis[3 * i + 1], along = axis[3 * i + 2];
        const D start = at[i] + o[0] * across + o[1] * along, direction = (forward + o[2] * across + o[3] * along) * o[4];
        point[i] += share[j] * (start + hits[b * s + j] * direction);
      }
    }
  }
