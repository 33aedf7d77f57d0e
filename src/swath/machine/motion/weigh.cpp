// What is in the tank of a machine becomes its load, by and by: the body of one native function (single_track_step_kernel.py).
//
// In: of `its` `empties`, (world, 14): 1 = the sheet has a tank, 2 = it stands on soil, too; `loaded` and `traction_of` in Python say the
// rest. Out: what of `cars`, `tractions` and `firm` depends on the load; `carried` [kg]; `needs`: 1 where soil gives way to it.

constexpr double STEP = 1.0, GRAVITY = 9.81;  // the mass follows the tank in steps of this [kg]; [m/s2], as in tyre.py
struct Empty { double kind, mass, behind, height, inertia, x, floor, area, spread, apart, sense, steered_x, wheelbase, thrust; };
const Empty& e = ((const Empty*)its.empties.data)[w];
const double tank = *(const double*)((const char*)its.tank_grain.data + w * (long long)its.tank_grain.strides[0]), grain = tank > 0.0 ? tank : 0.0;
if (!(__builtin_fabs(grain - its.carried.data[w]) >= STEP)) return;
its.carried.data[w] = grain;
if (e.kind == 2.0) its.needs.data[0] = 1;
double mass = e.mass, behind = e.behind, height = e.height, inertia = e.inertia;
if (grain > 0.0 && e.kind > 0.0) {
  mass = e.mass + grain;
  behind = (e.mass * e.behind - grain * e.x) / mass;
  height = (e.mass * e.height + grain * (e.floor + 0.5 * grain / e.area)) / mass;
  inertia = e.inertia + grain * e.spread / 12.0 + e.mass * grain / mass * e.apart;
}
auto& car = its.cars.data[w];
const double ahead = e.sense * behind;
its.tracks.data[w].side += (car.ahead - ahead) * its.tracks.data[w].turn;  // the speed of the fixed axle and the turn rate go on
car.ahead = ahead, car.behind = -e.steered_x - ahead, car.mass = mass, car.inertia = inertia, car.cg_height = height;
decltype(its.firm.data) both[2] = {&its.tractions.data[w], &its.firm.data[w]};
for (auto* traction : both) {
  traction->thrust = e.thrust / (mass * GRAVITY);
  if (e.wheelbase != 0.0) traction->level_share = 1.0 - behind / e.wheelbase, traction->grade_share = height / e.wheelbase;
}
