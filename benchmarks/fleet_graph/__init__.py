"""Whole fields planned on a graph drawn once: many plans a job, each decoded in tens of milliseconds.

    python -m benchmarks.fleet_graph 0 8 --plans 200 --driven --against same more

A peer of the planner in `swath.fleet`, on the jobs of `benchmarks.fleet_jobs`. `lanes` draws poses and ways
for each kind of machine, with the ground that bodies sweep, the crop that has to be cut before, and which
of them meet; `turns` works out rolled turns many at once; `plans.cpp` finds earliest arrivals in safe
intervals and keeps what is reserved; `decode` makes of a few choices what each machine does when; `search`
compares plans, some with machines parked; `as_schedule` has exact bodies along whole paths, so that
`swath.fleet` itself checks order, hours (`by_events`) and bodies (`driven`).

Turns lead from each end of a pass to the ten nearest passes and five lanes for which there is room, about
corners in a loop outside of the field or back in a bend, before a pond back along the pass.

To replace that planner it lacks

- plans for several combines without carts: they wait for each other at the truck and at the gate, where a
  plan takes half as long again as simple rules say;
- trailers as they come: one is in line at each node, with `SWING_M` more room in turns and `STAND_M` where
  it stands; where that is too little, exact paths can meet in an order that the plan does not have (counted
  as circles, and the next plan is taken);
- more choices: the order of passes is by distance and by what a lane beside is worth, changed by `bias`; a
  cart beside takes one run of cells, and no pass is put off until its cart is there;
- exact shares of grain: what headers share belongs to the pass that comes first in the plan, what an opened
  way cuts to the pass that it opens;
- several kinds of carts in a job (`carts[0]` stands for all where lanes are looked up), passes of others,
  directions of passes as a choice, and the user's dispatcher;
- room for all carts to wait: who has no place near the gate or the truck is left out;
- hours that never grow: fewer machines are tried, not smaller tanks and headers;
- size: 2 ha with four machines have 4,000 ways, of which sweeping their ground is most of the CPU time.
"""
