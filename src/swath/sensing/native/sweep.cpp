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
// Beams from b on, as many as a V has lanes, all between state k and the next; t [ns]: their times.
auto place = [&](auto t, int k, int b, auto put) {
  typedef decltype(t) V;
  const Node &n = node[k], &m = node[k + 1 < state_count ? k + 1 : k];
  V w = m.t > n.t ? (t - n.t) / (m.t - n.t) : t - t;
  w = w < 0.0 ? t - t : w;
  w = w > 1.0 ? t - t + 1.0 : w;
  V s[3], c[3], at[3];
  for (int i = 0; i < 3; ++i) {
    at[i] = n.at[i] + w * (m.at[i] - n.at[i]);
    const V x = w * (m.angle[i] - n.angle[i]), z = x * x;
    V sx = x * (1.0 - z * (1.0 / 6) * (1.0 - z * (1.0 / 20) * (1.0 - z * (1.0 / 42))));  // Taylor, 1e-17 up to 0.03
    V cx = 1.0 - 0.5 * z * (1.0 - z * (1.0 / 12) * (1.0 - z * (1.0 / 30) * (1.0 - z * (1.0 / 56))));
    if constexpr (sizeof(V) == sizeof(D)) {
      if (z > 1e-3) sx = ::sin(x), cx = ::cos(x);
    }
    s[i] = n.sine[i] * cx + n.cosine[i] * sx;
    c[i] = n.cosine[i] * cx - n.sine[i] * sx;
  }
  const V R[9] = {c[2] * c[1], c[2] * s[1] * s[0] - s[2] * c[0], c[2] * s[1] * c[0] + s[2] * s[0],
                  s[2] * c[1], s[2] * s[1] * s[0] + c[2] * c[0], s[2] * s[1] * c[0] - c[2] * s[0],
                  -s[1],       c[1] * s[0],                      c[1] * c[0]};
  for (int i = 0; i < 3; ++i) {
    const V *r = R + 3 * i, o = at[i] + (r[0] * base[0] + r[1] * base[1] + r[2] * base[2]);
    put((D*)origins.data + 3 * b + i, 3, o);
    for (int j = 0; j < 3; ++j)
      put((D*)rotations.data + 9 * b + 3 * i + j, 9, r[0] * base[3 + j] + r[1] * base[6 + j] + r[2] * base[9 + j]);
  }
};
typedef D Four __attribute__((ext_vector_type(4)));
auto put_one = [](D* to, int, D value) { *to = value; };
auto put_four = [](D* to, int apart, Four value) {
  for (int l = 0; l < 4; ++l) to[l * apart] = value[l];
};
int k = 0;
auto follow = [&](D t) {  // beams come in the order of time, or nearly so
  while (k + 2 < state_count && t > node[k + 1].t) ++k;
  while (k > 0 && t < node[k].t) --k;
  return k;
};
for (int b = 0; b < count;) {
  const D t = end + beam_t.data[b] * 1e9;
  const int here = follow(t);
  bool is_even = b + 4 <= count;  // four beams between the same states, which turn by little
  const Node &n = node[here], &m = node[here + 1 < state_count ? here + 1 : here];
  for (int i = 0; i < 3; ++i) is_even &= __builtin_fabs(m.angle[i] - n.angle[i]) < 0.03;
  Four times = t;
  for (int l = 1; is_even && l < 4; ++l) {
    times[l] = end + beam_t.data[b + l] * 1e9;
    is_even = follow(times[l]) == here;
  }
  if (is_even) place(times, here, b, put_four);
  else k = here, place(t, here, b, put_one);
  b += is_even ? 4 : 1;
}
