// Where each beam of a sweep starts and how the sensor is turned: the body of a native function.
//
// Positions and Euler angles are linear between neighbouring states, and held outside, as `poses_at` in sensing/mount.py; sines and
// cosines of the small turn from the state before are added to its own.
// In: states (time [ns], position, rotation), mounting (position, rotation), beam_t [s], end [ns], state_count, count.
// Out: origins (n, 3), rotations (n, 3, 3).

typedef double D;
struct Node { D t, at[3], angle[3], sine[3], cosine[3]; };
constexpr int ROOM = 64;  // states that are held at once
Node node[ROOM];
auto dot3 = [](const D* a, D x, D y, D z) { return a[0] * x + a[1] * y + a[2] * z; };
auto held = [](D x) { return x < -1.0 ? -1.0 : x > 1.0 ? 1.0 : x; };
for (int k = 0; k < state_count && k < ROOM; ++k) {
  const D* s = states.data + 13 * k;
  const D* r = s + 4;
  Node& n = node[k];
  n.t = s[0];
  n.angle[0] = ::atan2(r[7], r[8]);
  n.angle[1] = -::asin(held(r[6]));
  n.angle[2] = ::atan2(r[3], r[0]);
  for (int i = 0; i < 3; ++i) {
    n.at[i] = s[1 + i];
    if (k) {  // the shorter way round
      const D turn = n.angle[i] - node[k - 1].angle[i];
      n.angle[i] -= 6.283185307179586 * __builtin_floor(turn / 6.283185307179586 + 0.5);
    }
    n.sine[i] = ::sin(n.angle[i]);
    n.cosine[i] = ::cos(n.angle[i]);
  }
}
const D* base = mounting.data;
int k = 0;
for (int b = 0; b < count; ++b) {
  const D t = end + beam_t.data[b] * 1e9;
  while (k + 2 < state_count && t > node[k + 1].t) ++k;  // beams come in the order of time, or nearly so
  while (k > 0 && t < node[k].t) --k;
  const Node &n = node[k], &m = node[k + 1 < state_count ? k + 1 : k];
  D w = m.t > n.t ? (t - n.t) / (m.t - n.t) : 0.0;
  w = w < 0.0 ? 0.0 : w > 1.0 ? 1.0 : w;
  D s[3], c[3], at[3];
  for (int i = 0; i < 3; ++i) {
    at[i] = n.at[i] + w * (m.at[i] - n.at[i]);
    const D x = w * (m.angle[i] - n.angle[i]), z = x * x;
    D sx = x * (1.0 - z * (1.0 / 6) * (1.0 - z * (1.0 / 20) * (1.0 - z * (1.0 / 42))));  // Taylor, 1e-17 up to 0.03
    D cx = 1.0 - 0.5 * z * (1.0 - z * (1.0 / 12) * (1.0 - z * (1.0 / 30) * (1.0 - z * (1.0 / 56))));
    if (z > 1e-3) sx = ::sin(x), cx = ::cos(x);
    s[i] = n.sine[i] * cx + n.cosine[i] * sx;
    c[i] = n.cosine[i] * cx - n.sine[i] * sx;
  }
  const D R[9] = {c[2] * c[1], c[2] * s[1] * s[0] - s[2] * c[0], c[2] * s[1] * c[0] + s[2] * s[0],
                  s[2] * c[1], s[2] * s[1] * s[0] + c[2] * c[0], s[2] * s[1] * c[0] - c[2] * s[0],
                  -s[1],       c[1] * s[0],                      c[1] * c[0]};
  D *o = (D*)origins.data + 3 * b, *out = (D*)rotations.data + 9 * b;
  for (int i = 0; i < 3; ++i) {
    o[i] = at[i] + dot3(R + 3 * i, base[0], base[1], base[2]);
    for (int j = 0; j < 3; ++j) out[3 * i + j] = dot3(R + 3 * i, base[3 + j], base[6 + j], base[9 + j]);
  }
}
