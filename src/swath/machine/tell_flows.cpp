// What was cut in a step as a `CropFlow`, and how much of the width cuts, 0..1: the body of one native function (crop_kernel.py).
//
// In: of `its` `sums` as in land_kernel.py; `forget`: area swept over which the gauge forgets exponentially [m2]. Out: `flows` as
// `header.FLOWS`. `gauges`: (world, 2) area cut and swept [m2]; what stands cuts nothing.

if (!its.active.data[w]) return;
const double *sums = its.sums.data + its.sums.shape[1] * w, cut = sums[3], swept = sums[5], kept = wp::exp(-swept / its.forget.data[w]);
double *gauge = its.gauges.data + 2 * w, *flow = its.flows.data + 7 * w;
if (swept > 0.0) gauge[0] = gauge[0] * kept + cut, gauge[1] = gauge[1] * kept + swept;
const double fill = swept > 0.0 ? gauge[0] / gauge[1] : 0.0;
flow[0] = sums[0], flow[1] = sums[1], flow[2] = cut, flow[4] = fill < 1.0 ? fill : 1.0, flow[5] = its.clock.data[2] / 1.0e9, flow[6] = sums[2];
((long long*)flow)[3] = (long long)sums[4];
