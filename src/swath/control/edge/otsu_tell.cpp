// The edge as it is at the end of a step [ns]. edge: offset, heading, curvature, confidence, height of crop and stubble.
const auto& s = wp::index(settings, w);
const auto& state = wp::index(states, w);
const D age = now - state.time;
D* out = edge.data;
for (int k = 0; k < 6; ++k) out[k] = k == 2 || k == 3 ? 0.0 : NO_NUMBER;
if (!(state.is_there > 0.0 && state.is_found > 0.0 && age <= s.lost)) return;
const Line line = carried(line_of(state), speed * age / NS, s.sign * yaw_rate * age / NS);
const D steep = 1.0 + line.slope * line.slope, shift = __builtin_isfinite(state.shift) ? state.shift : guess_of(s, state.crop);
out[0] = s.sign * (line.offset + shift * __builtin_sqrt(steep));
out[1] = s.sign * ::atan(line.slope);
out[2] = s.sign * (line.bend / (steep * __builtin_sqrt(steep)));
out[3] = confidence_of((Point*)track.data, state, s);
out[4] = state.crop;
out[5] = state.stubble;
