"""Whole fields planned on a graph drawn once: many plans a job, each decoded in tens of milliseconds.

    python -m benchmarks.fleet_graph 0 8 --plans 60 --driven --against same more

A peer of the planner in `swath.fleet`, on the jobs of `benchmarks.fleet_jobs`. `lanes` draws poses and ways
for each kind of machine, with the ground that bodies sweep, the crop that has to be cut before, and which
of them meet; `turns` works out rolled turns many at once; `plans.cpp` finds earliest arrivals in safe
intervals and keeps what is reserved; `decode` makes of a few choices what each machine does when; `search`
compares plans, some with machines parked; `as_schedule` has exact bodies along whole paths, so that
`swath.fleet` itself checks order, hours (`by_events`) and bodies (`driven`).

To replace that planner it lacks

- short ways between passes: a third of a combine's time, since turns lead to the nearest lanes alone and only
  corners of rounds have a way made for them;
- an end in every plan, most with ponds, whose rings need a way that is opened first;
- trailers as they come: one is in line at each node, with `SWING_M` more room in turns; where it is not,
  exact paths can meet in an order that the plan does not have (counted as circles, and the next plan is
  taken);
- more choices: the order of passes is by distance and by what a lane beside is worth, changed by `skip`; a
  cart beside takes one run of cells, and no pass is put off until its cart is there;
- exact shares of grain: what headers share belongs to the pass that comes first in the plan, what an opened
  way cuts to the pass that it opens;
- several kinds of carts in a job (`carts[0]` stands for all where lanes are looked up), passes of others,
  directions of passes as a choice, and the user's dispatcher;
- hours that never grow: fewer machines are tried, not smaller tanks and headers;
- size: 2 ha with four machines have 3,500 ways and 1.2 million pairs that meet, which is most of the CPU
  time.
"""
