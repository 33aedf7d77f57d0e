// Straw that left a machine, and the polygons that it is laid in now: the body of one native function (crop_kernel.py).
//
// In: of `its` worlds `straw` since the last time [kg], `poses` (world, 12), `outlets` (world, 6): x, left and right y of the outlet, least
// way [m], how far its ends are from the machine's origin, 1 = heaped along the way. Out: `polygons` with mass and heading (nan = even),
// `found` of them. `states`: (world, 10) 1 once it was anywhere, its ends when straw was laid last, x, y, and the forward axis of the
// machine then, what is loose [kg].

struct State { double is_known; Point ends[2]; double origin[4], loose; };
State& state = ((State*)its.states.data)[w];
const double* outlet = its.outlets.data + 6 * w;
const double* pose = (const double*)((const char*)its.poses.data + w * (long long)its.poses.strides[0]);
its.found.data[w] = 0;
if (!its.active.data[w]) return;
state.loose += its.straw.data[w];
Point ends[2];
ends_at(pose, outlet, ends);
auto begin = [&] { state = {1.0, {ends[0], ends[1]}, {pose[0], pose[1], pose[3], pose[6]}, state.loose}; };
if (!state.is_known) { begin(); return; }
const double moved[2] = {pose[0] - state.origin[0], pose[1] - state.origin[1]}, turned[2] = {pose[3] - state.origin[2], pose[6] - state.origin[3]};
const double left[2] = {ends[0].x - state.ends[0].x, ends[0].y - state.ends[0].y}, right[2] = {ends[1].x - state.ends[1].x, ends[1].y - state.ends[1].y};
if (exact_length(moved, 2) + outlet[4] * exact_length(turned, 2) < outlet[3]) return;  // a quick look before the exact one
if (exact_length(left, 2) < outlet[3] && exact_length(right, 2) < outlet[3]) return;
Polygon* found = (Polygon*)its.polygons.data + 2 * w;
const int count = between(state.ends, ends, found);
const double area = (count > 0 ? found[0].area : 0.0) + (count > 1 ? found[1].area : 0.0);
if (!(area > 0.0)) return;
if (state.loose > 0.0) {
  for (int k = 0; k < count; ++k) {
    found[k].area = state.loose * found[k].area / area;
    found[k].more = outlet[5] != 0.0 ? wp::atan2(left[1] + right[1], left[0] + right[0]) : __builtin_nan("");
  }
  its.found.data[w] = count, state.loose = 0.0;
}
begin();
