// What the native functions for single rays share: 16 beams side by side in vector types of the compiler.
// A mask has -1 in the lanes that are meant and 0 in the others. No lane looks at another one.

typedef float F __attribute__((vector_size(64)));
typedef int I __attribute__((vector_size(64)));
typedef bool B __attribute__((ext_vector_type(16)));
constexpr int N = 16;
constexpr float MISS = 1.0e30f;
const I count_up = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};

auto put = [](float x) -> F { return F{} + x; };
auto puti = [](int x) -> I { return I{} + x; };
auto load = [](const float* p) -> F { F v; __builtin_memcpy(&v, p, 64); return v; };
auto loadi = [](const int* p) -> I { I v; __builtin_memcpy(&v, p, 64); return v; };
auto store = [](float* p, F v) { __builtin_memcpy(p, &v, 64); };
auto storei = [](int* p, I v) { __builtin_memcpy(p, &v, 64); };
auto bits = [](I m) -> unsigned {
  B b = __builtin_convertvector(m < 0, B);
  unsigned short u;
  __builtin_memcpy(&u, &b, 2);
  return u;
};
auto any = [&](I m) -> bool { return bits(m) != 0; };
auto pick = [](I m, F a, F b) -> F { return m ? a : b; };
auto picki = [](I m, I a, I b) -> I { return m ? a : b; };
auto least = [](F a, F b) -> F { return a < b ? a : b; };
auto most = [](F a, F b) -> F { return a > b ? a : b; };
auto within = [&](F a, float low, float high) -> F { return least(most(a, put(low)), put(high)); };
auto leasti = [](I a, I b) -> I { return a < b ? a : b; };
auto mosti = [](I a, I b) -> I { return a > b ? a : b; };
auto size_of = [](F a) -> F { return __builtin_elementwise_abs(a); };
auto root = [](F a) -> F { return __builtin_elementwise_sqrt(a); };
auto real = [](I a) -> F { return __builtin_convertvector(a, F); };
auto whole = [](F a) -> I { return __builtin_convertvector(a, I); };  // towards 0
auto down = [](F a) -> I { return __builtin_convertvector(__builtin_elementwise_floor(a), I); };
auto gather = [&](const float* p, I at, I on) -> F {  // lanes that are off read the first element
#if defined(__AVX512F__)
  return __builtin_ia32_gathersiv16sf(F{}, p, on ? at : I{}, -1, 4);
#endif
  int k[N];
  storei(k, on ? at : I{});
  return F{p[k[0]], p[k[1]], p[k[2]], p[k[3]], p[k[4]], p[k[5]], p[k[6]], p[k[7]], p[k[8]], p[k[9]], p[k[10]], p[k[11]], p[k[12]], p[k[13]], p[k[14]], p[k[15]]};
};
auto gatheri = [&](const int* p, I at, I on) -> I {
#if defined(__AVX512F__)
  return __builtin_ia32_gathersiv16si(I{}, p, on ? at : I{}, -1, 4);
#endif
  int k[N];
  storei(k, on ? at : I{});
  return I{p[k[0]], p[k[1]], p[k[2]], p[k[3]], p[k[4]], p[k[5]], p[k[6]], p[k[7]], p[k[8]], p[k[9]], p[k[10]], p[k[11]], p[k[12]], p[k[13]], p[k[14]], p[k[15]]};
};

// ---- Functions in float32, polynomials of the Cephes library (S. Moshier, netlib): about 1e-7
constexpr float LOG[] = {7.0376836292e-2f, -1.1514610310e-1f, 1.1676998740e-1f, -1.2420140846e-1f, 1.4249322787e-1f,
                         -1.6668057665e-1f, 2.0000714765e-1f, -2.4999993993e-1f, 3.3333331174e-1f};
constexpr float EXP[] = {1.9875691500e-4f, 1.3981999507e-3f, 8.3334519073e-3f, 4.1665795894e-2f, 1.6666665459e-1f, 5.0000001201e-1f};
constexpr float ARC_SIN[] = {4.2163199048e-2f, 2.4181311049e-2f, 4.5470025998e-2f, 7.4953002686e-2f, 1.6666752422e-1f};
constexpr float ERF[] = {1.061405429f, -1.453152027f, 1.421413741f, -0.284496736f, 0.254829592f};  // Abramowitz & Stegun 7.1.26
auto polynomial = [](F x, const auto& c) -> F {  // the first factor belongs to the highest power
  F p = {};
  for (float k : c) p = p * x + k;
  return p;
};
auto log_of = [&](F x) -> F {  // natural, x > 0
  I u;
  __builtin_memcpy(&u, &x, 64);
  I e = ((u >> 23) & 255) - 126;
  u = (u & 0x007fffff) | 0x3f000000;
  F m;
  __builtin_memcpy(&m, &u, 64);
  const I low = m < 0.70710678f;
  e += low;
  const F f = pick(low, m + m, m) - 1.0f, z = f * f;
  return f + (polynomial(f, LOG) * f * z - 2.12194440e-4f * real(e) - 0.5f * z) + 0.693359375f * real(e);
};
auto exp_of = [&](F x) -> F {
  x = within(x, -87.0f, 87.0f);
  const I n = down(x * 1.44269504f + 0.5f), u = (n + 127) << 23;
  x = (x - real(n) * 0.693359375f) + real(n) * 2.12194440e-4f;
  F two;
  __builtin_memcpy(&two, &u, 64);
  return (polynomial(x, EXP) * x * x + x + 1.0f) * two;
};
auto arc_cos = [&](F x) -> F {
  const F a = size_of(x);
  const I big = a > 0.5f;
  const F z = pick(big, 0.5f * (1.0f - a), a * a), s = pick(big, root(most(z, F{})), a), arc = s + s * z * polynomial(z, ARC_SIN);
  const F p = pick(big, arc + arc, 1.57079633f - arc);
  return pick(x < 0.0f, 3.14159265f - p, p);
};
auto normal_share = [&](F z) -> F {  // share of a standard normal below z
  const F x = size_of(z) * 0.70710678f, t = 1.0f / (1.0f + 0.3275911f * x), tail = 0.5f * polynomial(t, ERF) * t * exp_of(-x * x);
  return pick(z < 0.0f, tail, 1.0f - tail);
};
constexpr float SINE[] = {-1.9515295891e-4f, 8.3321608736e-3f, -1.6666654611e-1f}, COSINE[] = {2.443315711809948e-5f, -1.388731625493765e-3f, 4.166664568298827e-2f};
auto sine_of_turns = [&](F u) -> F {  // sin(2 pi u)
  const I q = down(u * 4.0f + 0.5f);  // quarter
  const F x = (u - 0.25f * real(q)) * 6.28318531f, z = x * x;
  const F s = x + x * z * polynomial(z, SINE), c = 1.0f - 0.5f * z + z * z * polynomial(z, COSINE), a = pick((q & 1) != 0, c, s);
  return pick((q & 2) != 0, -a, a);
};
