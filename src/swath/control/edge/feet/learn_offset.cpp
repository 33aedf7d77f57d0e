// Counts the rays of a look, each once, at the lateral place where it crosses the middle height of the echoes within, and fits the shift
// [m] where that is asked and enough heights within are known; nan = it was not fitted.
D *h = heights.data, *passed = seen.data, *held = passed + seen.shape[1];
const D ground = told.data[0], top = told.data[1], limit = told.data[2], over = larger(top - limit, 0.01);
const int layers = heights.shape[0];
D share = (0.5 * (limit + top) - limit) / over;
for (int i = 0; i < count; ++i) {
  const D place = lower.data[i] + share * (upper.data[i] - lower.data[i]);
  if (!(place > INSIDE_FROM && place < INSIDE_TO)) continue;
  const int k = (int)((level.data[i] - ground) / o.layer);
  h[k < 0 ? 0 : k > layers - 1 ? layers - 1 : k] += 1.0;
}
const D total = sum(h, layers);
if (total < FEWEST) return NO_NUMBER;
const D least = larger(height_at(h, layers, total, 1.0 - REACHED, o.layer), limit);
share = (height_at(h, layers, total, 0.5, o.layer) - limit) / over;
for (int i = 0; i < count; ++i) {
  const D place = lower.data[i] + share * (upper.data[i] - lower.data[i]);
  const int k = (int)__builtin_floor((place - o.first) / o.bin);
  if (k >= 0 && k < seen.shape[1]) (level.data[i] - ground > least ? held : passed)[k] += COUNT;
}
return told.data[4] > 0.0 ? fitted_shift(o, told.data[3], passed, held, scratch.data) : NO_NUMBER;
