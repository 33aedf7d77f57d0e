// How far the tops of a stand hang over the edge: what its height says of that, and how wide the header cuts.
//
// A stand that leans out over the edge shows a wall as sharp as that of an upright one, only further out, by z tan(lean) where
// its tops are at z. It is lower than one that stands, but how high that would be is known to a tenth or two of itself: one
// scanner on one side cannot tell a short stand that stands from a tall one that leans out. So the chance of every lean in
// every direction is kept. They make two modes, standing and leaning out; what is reported is the likelier one, with deviation
// and confidence of both, and the other one beside it.
//
// How wide the header cuts says where the feet stand: as far from its end as is missing of its width. It may miss more,
// tramlines and holes, never less.
//
// Before the body of a native function, after numbers.cpp. In: a row of detector_rows.py.

Row& q = *(Row*)row.data;
auto &s = q.step;
auto &f = q.feet;
const auto& d = q.detector;
const auto& b = q.block;
const auto& o = q.told;
// of a stand's usual height, mean and standard deviation of what is seen of it where it stands, and share of the rays that it
// stops: 26 upright stands of six crops, five scanners, `empirical` and `plants`
constexpr D DENSE[3] = {0.965, 0.03, 1.0}, THIN[3] = {0.77, 0.06, 0.75};
// chances that the header misses crop elsewhere, too, estimated: holes, evenly up to so much [m], and the two wheel tracks of a
// tramline, tyres of 0.3 to 0.65 m; passes with one where lines lie 24 to 36 m apart
constexpr D MISSED = 0.1, HOLES_M = 2.0, TRAMLINES = 0.3, TRACKS_M[2] = {0.6, 1.3};
// m: standard deviation of the width over a metre of a ragged edge; travel over which what the header cuts says how the stand
// leans; chance at most that what seems a ramp is one; all estimated
constexpr D UNEVEN = 0.05, CUT_M = 10.0, RAMPS = 0.98;
// of the overhang of the tops: where a dense, a thin wall is seen; standard deviation of the tangent of a lean that brightness
// shows
constexpr D EDGE_OF_TOPS = 0.95, EDGE_OF_THIN = 0.7, MODEL = 0.1;
// m between places that a hang may have, the first of them in such steps; chance that is none; how many places; leans, of those
// of overhang.py, that are those of a stand that stands, < 15 deg
constexpr D PLACE = 0.025, FIRST = -20.0, NEVER = 1e-6, PI = 3.141592653589793;
constexpr int PLACES = 100, STANDING = 6;

auto length = [&](D a, D b, D c = 0.0, D e = 0.0) {
  const D v[4] = {a, b, c, e};
  return exact_length(v, 4);
};
auto density = [&](D stopped) {  // how dense a stand is that stops a share of the rays, 0 = thin .. 1
  return within(0.0, (stopped - THIN[2]) / (DENSE[2] - THIN[2]), 1.0);
};
auto seen = [&](int k, D stopped) {  // mean, deviation of the height at which a stand is seen that stands, of its usual one
  return THIN[k] + density(stopped) * (DENSE[k] - THIN[k]);
};
auto by_height = [&](D crop, D crop_sd, D stopped, D* chance) {  // of every lean, in any direction, once a height was seen
  const D mean = seen(0, stopped), seen_sd = seen(1, stopped), known = square(seen_sd) + square(crop_sd / d.upright);
  const D high = smaller(crop / d.upright, mean + seen_sd);
  for (int i = 0; i < LEANS; ++i) {
    const D tall = mean * d.tall[i], own = d.height_sd * tall, sd = __builtin_sqrt(known + own * own), away = (high - tall) / sd;
    chance[i] = d.prior[i] * (::exp(-0.5 * (away * away)) / sd);
  }
  const D all = larger(sum(chance, LEANS), 1e-300);
  for (int i = 0; i < LEANS; ++i) chance[i] /= all;
};
auto lean_of = [&](D crop, D stopped) {  // of the stems off the vertical [rad], 0 where crop of this height may as well stand
  D chance[LEANS];
  if (!(d.upright > 0.0)) return 0.0;
  by_height(crop, 0.0, stopped, chance);
  if (!(sum(chance, STANDING) < 0.5)) return 0.0;
  return ::acos(smaller(larger(crop, 0.0) / (d.upright * seen(0, stopped)), 1.0));
};
D missing = 0.0, beside = 0.0, cut_sd = 0.0;  // means of the last way, deviation of the width [m]; 0 = nothing was cut
auto by_cut = [&](D hang) {  // likelihood of the feet so far behind the canopy's edge [m]
  if (!(cut_sd > 0.0)) return 1.0;
  const D more = missing - larger(beside + hang, 0.0), away = more / cut_sd;
  const D own = ::exp(-0.5 * (away * away)) / (__builtin_sqrt(2.0 * PI) * cut_sd);
  const D holes = MISSED / HOLES_M * (more > 0.0 && more < HOLES_M ? 1.0 : 0.0);
  const D tracks = TRAMLINES / (TRACKS_M[1] - TRACKS_M[0]) * (more > TRACKS_M[0] && more < TRACKS_M[1] ? 1.0 : 0.0);
  return (1.0 - MISSED - TRAMLINES) * own + holes + tracks + 1e-9;
};

struct Mode {  // how far the feet stand behind the edge of the tops, and its deviation [m], with what chance
  D chance, place, sd;
};
D hangs[PLACES] = {}, part[PLACES];  // chance of each place
auto place_of = [](int k) { return PLACE * (FIRST + k); };
auto put = [&](D hang, D chance) {
  const D k = __builtin_rint((hang - place_of(0)) / PLACE);
  hangs[k > 0.0 ? (int)(k < PLACES - 1.0 ? k : PLACES - 1.0) : 0] += chance;
};
auto put_normal = [&](const Mode& m) {
  for (int i = 0; i < NORMALS; ++i) {
    const D hang = m.place + m.sd * d.deviation[i];
    put(hang, m.chance * d.normal[i] * by_cut(hang));
  }
};
auto mode_of = [&](int first, int count) {  // at the median of these places
  const D* chance = hangs + first;
  const D all = larger(sum(chance, count), 1e-12), half = 0.5 * all;
  D before = 0.0, last = 0.0, found = place_of(first + count - 1);
  for (int i = 0; i < count; ++i) {
    before = before + chance[i];
    const D middle = before - 0.5 * chance[i];
    if (middle > half) {
      const D low = place_of(first + i - 1), slope = (place_of(first + i) - low) / (middle - last);
      found = i == 0 ? place_of(first) : half == last ? low : slope * (half - last) + low;
      break;
    }
    last = middle;
  }
  for (int i = 0; i < count; ++i) part[i] = chance[i] * ((place_of(first + i) - found) * (place_of(first + i) - found));
  return Mode{all, found, __builtin_sqrt(sum(part, count) / all)};
};
auto fill = [&](D crop, D crop_sd, D stopped, Mode ramp) {  // crop: over the ground, and its deviation [m]; ramp: leaning inward
  if (o.is_told > 0.0) {  // by scanners on several sides
    const D share = crop * (EDGE_OF_THIN + density(stopped) * (EDGE_OF_TOPS - EDGE_OF_THIN)), rest = 1.0 - ramp.chance;
    const bool stands = f.low == 0.0 && o.lean < 2.0 * o.sd;
    put_normal(stands ? Mode{rest, 0.0, 0.0} : ramp);
    put_normal(stands ? ramp : Mode{rest, share * o.lean, share * length(o.sd, MODEL)});
    return;
  }
  ramp.chance = smaller(ramp.chance, RAMPS);
  D rest = 1.0 - ramp.chance, all = 0.0, chance[LEANS], each[LEANS * DIRECTIONS];
  if (d.upright > 0.0) {
    by_height(crop, crop_sd, stopped, chance);
    for (int k = 0; k < LEANS * DIRECTIONS; ++k) each[k] = chance[k / DIRECTIONS] * d.no_ramp[k];
    all = sum(each, LEANS * DIRECTIONS);
  }
  if (!(all > 0.0)) put_normal({rest, 0.0, d.upright / 3.0});  // any height up to that, leaning or not
  else {
    const D tops = smaller(crop, d.upright * (1.0 + d.height_sd));  // higher: it is no crop of that height
    if (s.cut_way > 0.0) {
      missing = s.cut_missing / s.cut_way, beside = s.cut_beside / s.cut_way;
      cut_sd = length(d.cut_sd, UNEVEN / __builtin_sqrt(larger(s.cut_way, 1.0)));
    }
    rest /= all;
    for (int k = 0; k < LEANS * DIRECTIONS; ++k)
      if (each[k] > 0.0) put(tops * d.hang[k], rest * each[k] * by_cut(tops * d.hang[k]));
  }
  put_normal(ramp);
};
