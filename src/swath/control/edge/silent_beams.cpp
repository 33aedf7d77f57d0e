// Beams that never answer while those beside them do: dirt on the window, or a dead part of the scanner.
//
// Where dust or the open sky swallows beams it swallows their neighbours too, and "no echo" says something of what is there. A
// beam that alone is silent says nothing, always of the same place. Given back: whether the scan is new.
constexpr int WINDOW = 50, NEIGHBOURS = 4;  // scans that a beam has to miss; beams to either side among which one has to answer
constexpr D ANSWERS = 0.2;  // share of the scans that it has to
const int count = ranges.shape[1];
if (stamp <= step.scan_t) return false;  // it was taken
if (ranges.shape[2] == 0 || count == 0) return true;
if (s.echo_beams != count) {
  for (int i = 0; i < count; ++i) beams[i].echoes = beams[i].is_dead = 0.0;
  s.echo_beams = count;
  s.echo_scans = 0.0;
}
for (int i = 0; i < count; ++i) beams[i].echoes += wp::index(ranges, w, i, 0) > 0.0f;
if (++s.echo_scans < WINDOW) return true;
s.echo_scans = 0.0;
int before = -1, after = -1;  // the nearest ones that answered
for (int i = 0; i < count; ++i) {
  if (beams[i].echoes > 0.0) before = i;
  for (after = after < i ? i : after; after < count && beams[after].echoes == 0.0;) ++after;
  const bool is_near = before >= 0 && after < count && i - before <= NEIGHBOURS && after - i <= NEIGHBOURS;
  auto answers = [&](int k) { return beams[k].echoes >= ANSWERS * WINDOW; };
  beams[i].is_dead = beams[i].echoes == 0.0 && is_near && answers(before) && answers(after);
}
for (int i = 0; i < count; ++i) beams[i].echoes = 0.0;
return true;
