// Echoes of beams from what their sub-rays met: the body of a native function (receive_kernel.py). Rules as in sensing/echo.py.
//
// In: `whole`: addresses of distances and albedos (n, s), of weights (s), of distances, intensities and signals of echoes
// (n, echoes), of shares (n, echoes, s), of 6 s spare numbers and 2 s spare integers; n, s, echoes, rule, within. `real`: part of
// the beam's energy at which `percentile`, and of the echo's at which `leading_edge` triggers, gap [m], least energy [1/m2].
// Numbers of a beam are added as numpy adds them, in pairs of eighths; those that do not belong to an echo count as 0 in their place.

typedef double D;
typedef long long L;
enum Rule { ONE, FIRST, LAST, STRONGEST, ALL };
enum Within { NEAREST, PERCENTILE, MEAN, LEADING_EDGE };
const D *distance = (const D*)whole.data[0], *albedo = (const D*)whole.data[1], *weight = (const D*)whole.data[2];
D *far = (D*)whole.data[3], *intensity = (D*)whole.data[4], *signal = (D*)whole.data[5], *shares = (D*)whole.data[6];
D* spare = (D*)whole.data[7];
L *order = (L*)whole.data[8], beams = whole.data[9], s = whole.data[10], echoes = whole.data[11];
const L rule = whole.data[12], within = whole.data[13];
const D percentile = real.data[0], threshold = real.data[1], gap = real.data[2], least = real.data[3];
constexpr D EPS = 1.0e-9, NOTHING = __builtin_nan("");
constexpr L RUN = 16;  // hits that are sorted one by one
D *range = spare, *heavy = spare + s, *bright = spare + 2 * s, *energy = spare + 3 * s, *held = spare + 4 * s, *part = spare + 5 * s;

auto sum = [](auto&& self, const D* v, L count) -> D {
  if (count > 128) {
    const L half = count / 2 - count / 2 % 8;
    return self(self, v, half) + self(self, v + half, count - half);
  }
  D total = 0.0;
  L i = 0;
  if (count >= 8) {
    D r[8];
    for (; i < 8; ++i) r[i] = v[i];
    for (; i < count - count % 8; i += 8)
      for (L k = 0; k < 8; ++k) r[k] += v[i + k];
    total = ((r[0] + r[1]) + (r[2] + r[3])) + ((r[4] + r[5]) + (r[6] + r[7]));
  }
  for (; i < count; ++i) total += v[i];
  return total;
};

for (L b = 0; b < beams; ++b) {
  const D *d = distance + b * s, *a = albedo + b * s;
  for (L k = 0; k < echoes; ++k) far[b * echoes + k] = intensity[b * echoes + k] = NOTHING, signal[b * echoes + k] = 0.0;
  for (L i = 0; i < echoes * s; ++i) shares[b * echoes * s + i] = 0.0;

  // hits by distance, of equal ones the earlier sub-ray first
  L hits = 0, *from = order, *to = order + s;
  for (L i = 0; i < s; ++i) if (d[i] - d[i] == 0.0) from[hits++] = i;
  for (L first = 0; first < hits; first += RUN)
    for (L i = first + 1; i < hits && i < first + RUN; ++i) {
      const L one = from[i];
      L k = i;
      for (; k > first && d[one] < d[from[k - 1]]; --k) from[k] = from[k - 1];
      from[k] = one;
    }
  for (L run = RUN; run < hits; run *= 2) {
    for (L first = 0; first < hits; first += 2 * run) {
      const L middle = first + run < hits ? first + run : hits, last = first + 2 * run < hits ? first + 2 * run : hits;
      L i = first, j = middle;
      for (L k = first; k < last; ++k) to[k] = j < last && (i >= middle || d[from[j]] < d[from[i]]) ? from[j++] : from[i++];
    }
    L* other = from;
    from = to;
    to = other;
  }
  for (L i = 0; i < s; ++i) {
    const bool is_hit = i < hits;
    range[i] = is_hit ? d[from[i]] : 0.0;
    heavy[i] = is_hit ? weight[from[i]] : 0.0;
    bright[i] = is_hit ? heavy[i] * a[from[i]] : 0.0;
    const D r = range[i] > 1.0e-3 ? range[i] : 1.0e-3;
    energy[i] = bright[i] / (r * r);
  }

  L* is_in = to;  // of the echo that is looked at
  auto sum_in = [&](const D* v) {
    for (L i = 0; i < s; ++i) held[i] = is_in[i] ? v[i] : 0.0;
    return sum(sum, held, s);
  };
  L seen = 0;  // echoes so far
  auto take_echo = [&]() {  // of those in it: is it seen, and where does it go?
    const D total = sum_in(energy), strength = total / (least > 1.0e-12 ? least : 1.0e-12);
    if (!(strength >= 1.0)) return;
    L first = -1;
    D at = 0.0;
    if (within == MEAN) {
      const D whole_energy = total > 0.0 ? total : 1.0;
      for (L i = 0; i < s; ++i) part[i] = is_in[i] ? energy[i] / whole_energy : 0.0;
      if (!(sum(sum, part, s) > 0.5)) return;
      for (L i = 0; i < s; ++i) held[i] = part[i] * range[i];
      at = sum(sum, held, s);
    } else {
      const D floor_energy = least < total ? least : total, edge = threshold * total;
      const D needed = within == PERCENTILE ? percentile * sum_in(heavy) - EPS : (edge > floor_energy ? edge : floor_energy) * (1.0 - EPS);
      const D* counted = within == PERCENTILE ? heavy : energy;
      D reached = 0.0;
      for (L i = 0; i < hits && first < 0; ++i) {
        if (!is_in[i]) continue;
        reached += counted[i];
        if (within == NEAREST || reached >= needed) first = i;
      }
      if (first < 0) return;
      at = range[first];
    }
    L slot = b * echoes;
    if (rule == ALL || rule == FIRST) {
      if (seen >= echoes) return;
      slot += seen;
    } else if (rule == STRONGEST && seen && !(strength > signal[slot])) return;
    ++seen;
    far[slot] = at;
    intensity[slot] = sum_in(bright);
    signal[slot] = strength;
    D* share = shares + slot * s;
    for (L i = 0; i < s; ++i) share[i] = 0.0;
    if (first >= 0) share[from[first]] = 1.0;
    else
      for (L i = 0; i < hits; ++i) share[from[i]] = part[i];
  };

  for (L i = 0; i < s; ++i) is_in[i] = 0;
  for (L first = 0, last; first < hits; first = last) {  // pulse after pulse
    for (last = first + 1; last < hits && range[last] - range[last - 1] < gap;) ++last;
    if (rule == ONE) {
      for (L i = 0; i < s; ++i) held[i] = i >= first && i < last ? energy[i] : 0.0;
      if (sum(sum, held, s) >= least)
        for (L i = first; i < last; ++i) is_in[i] = 1;
      continue;
    }
    for (L i = first; i < last; ++i) is_in[i] = 1;
    take_echo();
    for (L i = first; i < last; ++i) is_in[i] = 0;
  }
  if (rule == ONE && hits) take_echo();
}
