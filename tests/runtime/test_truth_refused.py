"""A control part of the user's own is not given the true state of the machine."""

from pathlib import Path

import pytest

from swath.core.errors import InputError
from swath.runtime.assembly import assemble
from swath.scenario.scenario import load_scenario

pytestmark = pytest.mark.usefixtures("code_allowed")

LAW = """
from swath.core.component import Port
from swath.signals import MachineState, ScanTruth, SteerCommand


class Law:
    inputs = (Port("{port}", {signal}),)
    outputs = (Port("command", SteerCommand),)

    def __init__(self, params, setup):
        pass

    def reset(self, stream):
        return {{"command": SteerCommand(0, 0.0, False)}}

    def step(self, t, dt, inputs):
        return {{"command": SteerCommand(t + dt, 0.0, True)}}
"""


@pytest.mark.parametrize(
    ("port", "signal", "wires"),
    [("state", "MachineState", ""), ("truth", "ScanTruth", ", wires: {truth: lidar.truth}")],
)
def test_a_law_that_asks_for_the_truth_is_refused(tmp_path, monkeypatch, port, signal, wires):
    file = Path("law.py")  # as short as the message that quotes it has to be
    monkeypatch.chdir(tmp_path)
    file.write_text(LAW.format(port=port, signal=signal))
    scenario = load_scenario("straight", sets=[f"combine.steer={{level: '{file}:Law'{wires}}}"])
    with pytest.raises(
        InputError, match=rf"combine\.steer\.level .* without the input {port}: control never"
    ):
        assemble(scenario)
