"""A level that takes what its neighbours do not send says which of them to choose."""

import pytest

from swath.core.errors import InputError
from swath.runtime.assembly import assemble
from swath.scenario.scenario import load_scenario


@pytest.mark.parametrize(
    ("wish", "said"),
    [
        ("crop_flow=counted", r"crop_flow.level = counted: expected combine.process at level organs"),
        ("cleaning=model", r"cleaning.level = model: expected combine.process at level organs"),
        ("settings=climb", r"settings.level = climb: expected a slot combine.crop_flow beside it"),
    ],
)
def test_one_error_says_what_to_set(wish, said):
    with pytest.raises(InputError, match=said):
        assemble(load_scenario("straight", sets=[f"combine.{wish}"]))
    wishes = [f"combine.{wish}", "combine.process.level=organs"]
    if wish.startswith("settings"):
        wishes.append("combine.crop_flow=counted")
    assemble(load_scenario("straight", sets=wishes)).close()


def test_a_part_alone_takes_from_elsewhere():
    world = assemble(load_scenario("straight", sets=["combine.settings=climb"]), only=["combine.settings"])
    assert list(world.machines["combine"].parts) == ["settings"]
    world.close()
