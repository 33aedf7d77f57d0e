"""What observers look at: every sample once, in the order in which they were sent."""

import numpy as np
import pytest

from swath.core.blocks import Block, Blocks, Seen
from swath.core.rows import held_row, row_like
from swath.signals import CropFlow, Odometry, SpeedCommand

MADE = (
    lambda t: Odometry(t, 1.5 * t, 0.0, 0.01),
    lambda t: SpeedCommand(t, -1.0 * t),
    lambda t: CropFlow(t, 0.1, 0.2, 0.3, t, 0.5, 0.01),
)


@pytest.mark.parametrize("seed", range(5))
def test_an_output_may_change_its_form_from_sample_to_sample(seed):
    rng, blocks, sent, found = np.random.default_rng(seed), Blocks(), [], []
    row, changes = None, rng.random()
    for t in range(80):
        sample = MADE[rng.integers(3)](t) if row is None or rng.random() < changes else sent[-1]
        if row is None or row.kind is not type(sample) or rng.random() < changes:
            row = row_like(sample, 1) if rng.random() < 0.5 else held_row(type(sample), 1)
        row.take({0: sample})
        blocks.add("combine.own", t, {"own": row})
        sent.append(sample)
        if rng.random() < 0.1 or t == 79:
            seen = Seen([Block(trail, 0, count) for trail, count in blocks.take()])
            pieces = sorted(seen.blocks, key=lambda block: int(block.orders[0]))
            found += [block.sample(k) for block in pieces for k in range(len(block))]
    assert found == sent
