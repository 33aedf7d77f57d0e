"""The tolerance of every level in numbers, beside the words of the level that state it.

A new level needs an entry here: the tests go through the levels that the registry knows.
"""

from dataclasses import dataclass

import pytest

from swath.core.errors import MissingExtra
from swath.documents.validation import known_keys
from swath.scenario.slots import CATALOGUE


@dataclass(frozen=True)
class Limit:
    """said: part of the level's own `tolerance`; value: what it comes to in the case of the slot here."""

    said: str
    value: object


EXACT = 1e-12
LIMITS = {
    "terrain": {
        "plane": Limit("exact", EXACT),
        "formula": Limit("slope and waves exact", EXACT),
        "dem": Limit("bilinear between cell centres", 1e-6),  # float32 values
    },
    "stand": {
        "uniform": Limit("exact", 0.0),
        "maps": Limit("constant over a tile of 1 m", 0.0),
        "bands": Limit("constant over a tile of 1 m", 0.0),
    },
    # of the yaw gain and of the way aside after 30 deg, relative to multibody; multibody: of its roll
    "motion": {
        "kinematic": Limit(
            "yaw gain 1.8 to 4 % high, offset after 30 deg -3 to +21 %", ((0.018, 0.04), (-0.03, 0.21))
        ),
        "single_track": Limit(
            "yaw gain within 0.2 %, offset after 30 deg within 2.8 %", ((-0.002, 0.002), (-0.028, 0.028))
        ),
        "multibody": Limit("within 0.1 to 3 % of hand calculation", 0.03),
        "articulated": Limit("trailer within 5 cm of kinematic", 0.05),
    },
    "unload": {
        "ideal": Limit("exact", 0.01),
        "auger": Limit("equal to ideal without ramps", 0.01),
    },
    # volume over that of the closed form when the first grain runs over the rim, one spot
    "heap": {
        "height_map": Limit("first grain over the rim within 2 % of the closed forms", 0.02),
        "cones": Limit("first grain over the rim within 4 % of height_map", 0.04),
    },
    # mass that floats or lies, of what was raised
    "dust": {"plume": Limit("within 1 % of Briggs' plume", 0.01)},
    # straight on, sensors without error: of the place [m]
    "pose": {
        "raw": Limit("exact with sensors without error on a straight line", 1e-6),
        "ekf": Limit("within 2 mm with sensors without error on a straight line", 2e-3),
    },
    "peer_link": {
        "ideal": Limit("exact", EXACT),
        "radio": Limit("equal to ideal with every number at 0", EXACT),
    },
    # of place and height of the rim and of the grain [m]
    "box": {
        "truth": Limit("exact", 1e-9),
        "rim": Limit("rim within 0.10 m and 1 deg, grain within 0.10 m", 0.10),
    },
    # beyond the outlines of the other machine, up to which echoes go [m]
    "scan_filter": {"peer_body": Limit("to its margin", 0.5)},
    # of the largest heap, poured along the places that a strategy wants; unloader: s after its limits
    "cooperate": {
        "one_spot": Limit("fills 71 to 78 %", (0.71, 0.78)),
        "front_to_back": Limit("fills 95 % and more", (0.95, 0.99)),
        "by_profile": Limit("fills 95 % and more", (0.95, 0.99)),
        "unloader": Limit("stops within a step", 0.05),
    },
    "header": {
        "fixed_height": Limit("nothing is shed or lifted", 0.0),
        "height_control": Limit("stiff knife", 0.01),
        "profile": Limit("within 2 %", 0.02),
    },
    # mean time from knife to tank [s]: from, to
    "process": {
        "constant": Limit("no transport delay", (0.0, 0.1)),
        "delay_line": Limit("mean delays exact, spread by less than a step", (13.9, 14.1)),
        "threshing": Limit("steady losses equal the closed forms, mass within 1e-12", (10.0, 15.0)),
        "organs": Limit("equal to `threshing` where the organs are those of it", (10.0, 15.0)),
    },
    # mean time from knife to drum [s]: from, to
    "feeder": {
        "ideal": Limit("exact", (0.0, 0.1)),
        "model": Limit("mean delays exact at a steady flow", (2.5, 4.0)),
    },
    "threshing": {"ideal": Limit("exact", 0.0), "model": Limit("equal to the closed forms", EXACT)},
    "separation": {
        "ideal": Limit("exact", 0.0),
        "model": Limit("equal to the closed forms", 1e-9),
        "walkers": Limit("equal to the closed form", 1e-9),
    },
    "cleaning": {
        "ideal": Limit("exact", 0.0),
        "overload": Limit("equal to the closed forms", EXACT),
        "model": Limit("equal to its formula", EXACT),
    },
    "settings": {
        "fixed": Limit("exact", EXACT),
        "table": Limit("exact", EXACT),
        "climb": Limit("within a step of the least loss", EXACT),  # in its first step as it starts
    },
    # of the delay [s]
    "returns": {"ideal": Limit("exact", EXACT), "model": Limit("delay exact to rounding", EXACT)},
    "powertrain": {
        "ideal": Limit("equal to hydrostat within the governor's droop", 0.05),
        "hydrostat": Limit("steady speeds equal to the torque balance", 1e-3),
    },
    "crop_flow": {
        "ideal": Limit("exact", EXACT),
        "delayed": Limit("equal to ideal with every number at 0", EXACT),
        "counted": Limit("equal to ideal with every number at 0", EXACT),
    },
    "lidar": {
        "plants": Limit("first returns within 1 cm of the closed form", 0.01),
        "empirical": Limit("Wasserstein-1 2 cm", 0.02),
        "replay": Limit("within 2 cm of plants (Wasserstein-1)", 0.02),
        "profile": Limit("Wasserstein-1 1.5 cm", 0.015),
    },
    "camera": {
        "rays": Limit("pixels within 0.5 px of the pinhole formula", 0.5),
        "error": Limit("equal to rays within 0.5 px without distortion", 0.5),
        "depth": Limit("equal to rays within 0.5 px without noise", 0.5),
        "thermal": Limit("equal to rays within 0.5 px", 0.5),
    },
    "odometry": {
        "ideal": Limit("exact", EXACT),
        "error": Limit("equal to ideal with every error at 0", EXACT),
    },
    "ground_speed": {
        "ideal": Limit("exact", EXACT),
        "radar": Limit("equal to ideal without noise on level ground", 1e-9),
    },
    "radar": {
        "ideal": Limit("radial speed of what stands within 1 mm/s", 1e-3),
        "error": Limit("equal to ideal without noise and latency", 1e-3),
        "rays": Limit("a post within 0.05 m and 0.05 m/s", 0.05),
    },
    "field_map": {
        "ideal": Limit("exact", EXACT),
        "error": Limit("equal to ideal at correlation 1 without kernel and cells", EXACT),
        "file": Limit("bit for bit the map's values", EXACT),
    },
    "objects": {
        "onnx": Limit("that of the network", EXACT),
        "truth": Limit("exact", EXACT),
        "error": Limit("equal to truth with every number at 0", EXACT),
        "cluster": Limit("place of a person within 0.3 m", 0.3),
        "radar": Limit("place of a person within 0.6 m", 0.6),
        "joined": Limit("place of a person within 0.3 m", 0.3),
    },
    "gnss": {
        "ideal": Limit("exact", 1e-5),  # speeds from poses 20 ms apart
        "error": Limit("equal to ideal with every error at 0", 1e-5),
        "sky": Limit("equal to ideal with every error at 0", 1e-5),
    },
    "imu": {
        "ideal": Limit("exact", 1e-5),  # means over poses 5 ms apart
        "error": Limit("equal to ideal with every error at 0", 1e-5),
    },
    "edge": {
        "onnx": Limit("that of the network", EXACT),
        "likelihood_ratio": Limit("within 0.05 m RMS of the true edge at 50 to 700 stems/m2", 0.05),
        "joined": Limit("within 0.05 m RMS of the true edge at 500 stems/m2", 0.05),
        "otsu": Limit("within 0.05 m RMS of the true edge at 500 stems/m2", 0.05),
        "truth": Limit("15.6 mm cells", 0.0157),
    },
    "ahead": {"penetration": Limit("extinction unbiased in a random stand", 0.08)},
    "steer": {
        "constant": Limit("exact", 1e-9),
        "preview": Limit("2 cm RMS at 7 km/h on a straight edge known to 3 cm", 0.02),
        "pure_pursuit": Limit("3 cm RMS at 7 km/h on a straight edge known to 3 cm", 0.03),
        "stanley": Limit("3 cm RMS at 7 km/h on a straight edge known to 3 cm", 0.03),
        "station": Limit("against its differential equation within 2 cm", 0.02),
        "edge_or_path": Limit("2 cm RMS at 7 km/h on a straight edge known to 3 cm", 0.02),
        "path": Limit("3 cm RMS at 7 km/h on a straight path with RTK", 0.03),
    },
    "speed": {
        "constant": Limit("exact", 1e-6),
        "feed_rate": Limit("no error in steady state", 1e-3),
        "look_ahead": Limit("as good as the sight", 0.01),
        "station": Limit("against its differential equation within 2 cm", 0.02),
        "map_ahead": Limit("as good as the map", 0.01),
        "joined_ahead": Limit("in time for what comes", 0.01),
    },
    "steering": {
        "actuator": Limit("exact solution of its equations at any step", EXACT),
        "ideal": Limit("no dead time, rate limit, lag or dead band", EXACT),
    },
}  # fmt: skip


OF_USERS = {"onnx"}  # as good as the network that a user gives: tests/control/test_onnx.py


def each_level(slot):
    """Run a test with `level` and `limit` for every level of a slot that the registry knows."""
    known = LIMITS.get(slot, {})
    names = [name for name in CATALOGUE.registry.names(slot) if name not in OF_USERS]
    cases = [(name, known[name].value if name in known else None) for name in names]
    return pytest.mark.parametrize(("level", "limit"), cases, ids=[name for name, _ in cases])


def make(slot, level, setup, **params):
    """The component of a level, not yet reset; skips where its extra is not installed."""
    found = CATALOGUE.registry.get(slot, level)
    try:
        return found.component(found.params and found.params(**params), setup)
    except MissingExtra as error:
        pytest.skip(str(error))


def keys_of(slot, level):
    """Names of a level's parameters."""
    return set(known_keys(CATALOGUE.registry.get(slot, level).params))
