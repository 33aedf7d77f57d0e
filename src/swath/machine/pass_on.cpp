// What headers took in since the last step goes to tank, ground and losses: the body of one native function (crop_kernel.py).
//
// In: of `its` worlds `grain` and `cut_straw` of the trail of crop flows, (k, world) [kg]; `shares`: (world, 2) of the grain that is lost,
// and what the tank holds [kg], 0 = without end. Out: `straw` that left during the step [kg]; `loads` as `constant.LOADS`. `sums`:
// (world, 6) compensated sums [kg] as `Total`, of tank, losses and straw.

auto add = [](double* sum, double value) {
  const double next = sum[0] + value;
  sum[1] += __builtin_fabs(sum[0]) >= __builtin_fabs(value) ? (sum[0] - next) + value : (value - next) + sum[0];
  sum[0] = next;
};
auto at = [&](const auto& trail, int k) -> double { return *(const double*)((const char*)trail.data + k * (long long)trail.strides[0] + w * (long long)trail.strides[1]); };
double *tank = its.sums.data + 6 * w, *losses = tank + 2, *dropped = tank + 4, *load = its.loads.data + 14 * w;
const double loss = its.shares.data[2 * w], capacity = its.shares.data[2 * w + 1];
double grain = 0.0, straw = 0.0, lost = 0.0;
for (int k = 0; k < (int)its.head.data[1]; ++k) {
  const double came = at(its.grain, k), gone = came * loss, left = came - gone, too_much = tank[0] + tank[1] + left - capacity;
  const double over = !(capacity > 0.0) || !(too_much > 0.0) ? 0.0 : too_much < left ? too_much : left;
  add(tank, left - over), add(losses, gone + over), add(dropped, at(its.cut_straw, k));
  grain = grain + came - gone, straw += at(its.cut_straw, k), lost += gone;
}
its.straw.data[w] = straw;
const double rate = 1e9 / (double)its.clock.data[2], feed = grain * rate + lost * rate + straw * rate;
load[0] = tank[0] + tank[1], load[1] = losses[0] + losses[1], load[2] = dropped[0] + dropped[1];
load[5] = grain * rate, load[6] = straw * rate, load[7] = load[8] = load[9] = feed;  // header, feeder, drum
load[10] = straw * rate, load[11] = grain * rate, load[12] = lost * rate, load[13] = feed > 0.0 ? loss : 0.0;
