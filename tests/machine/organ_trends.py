"""How losses, quality and power of a combine go with its settings: what is published, and a row of organs."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from swath.core.schedule import NS
from swath.machine.drivetrain_sheet import drivetrain_of
from swath.machine.machine_sheet import load_machine
from swath.signals import OrganSettings
from swath.signals.settings import own_settings
from tests.machine.machine_fakes import STREAM, Ground, site
from tests.machine.process_rig import Row, flow, state

QUALITIES = ("unthreshed", "separation", "shoe loss", "broken", "tank MOG", "returns", "power")
# With a setting that goes up: + and - monotone, U an inner least, 0 within a quarter (John Deere OMDXE11330,
# New Holland CR manual, section 6; U of separation and what these do not say: estimates).
# Ranges are over the manual's settings, of drum and concave those of a machine (300 to 1300 rpm, 0 to 42 mm).
TRENDS = {
    "drum": ("-U+++U+", np.linspace(0.45, 1.25, 9)),
    "concave": ("+U---U-", np.linspace(0.6, 2.6, 9)),
    "fan": ("00U0-++", np.linspace(0.8, 1.3, 7)),
    "upper": ("00U0++0", np.linspace(0.6, 2.0, 7)),
    "lower": ("000-+-0", np.linspace(0.7, 2.5, 7)),
    "vane": ("++0--0-", np.linspace(0.6, 1.5, 7)),
    "feed": ("++U-+++", np.linspace(0.6, 1.3, 8)),
}
FLOW = 23.8, 15.4  # nominal grain and straw [kg/s]
STEP, STEPS = NS // 2, 60
STRAW = {"wheat": (0.5, 0.8), "barley": (0.6, 0.9), "oats": (0.9, 1.2), "rye": (1.0, 1.4),
         "rape": (1.2, 2.0), "soy": (0.8, 1.2), "maize": (0.15, 0.3)}  # fmt: skip
"""Straw over grain; wheat Allen 1988, the rest estimates."""
WET = {"grain_moisture_percent": (11.0, 20.0), "straw_moisture_percent": (9.0, 25.0)}
MACHINES = (load_machine("lexion-700"), {}), (load_machine("combine-walkers"), {"separation": "walkers"})
TAKEN_BARLEY = 0.7, 0.49  # of the straw of wheat, rotors and walkers (PAMI)


def steady(
    crop="wheat", keys=(), feed=1.0, levels=(), machine=None, nominal=FLOW, slope=(0.0, 0.0), **over_own
):
    """What `QUALITIES` come to: shares of grain fed, on the shoe, to the tank, of the shoe's flow, and W.

    nominal: grain and straw at feed 1 [kg/s]; slope: roll and pitch [rad]; over_own: settings over those of
    the manual
    """
    ground, h = Ground(), STEP / NS
    ground.stand = SimpleNamespace(crop=crop)
    setup = site(ground, period=h, machine=machine)
    row = Row(setup, levels, keys)
    row.reset(STREAM)
    own = own_settings(setup.machine.works, crop)
    row.settings = OrganSettings(0, **{name: own[name] * over for name, over in over_own.items()})
    grain, straw = (m * feed * h for m in nominal)
    for k in range(STEPS):
        at = state(k, 1.0 * k, 2.0, *slope)
        made = row.step(k * STEP, STEP, {"flow": (flow(k, grain, straw, h),), "state": at})
    load, organs = made["load"], made["organs"]
    unthreshed, separation, shoe = (
        lost * h / grain for lost in (load.threshing_loss, load.separation_loss, load.cleaning_loss)
    )
    shoe /= 1.0 - unthreshed - separation
    power = organs.header_power + organs.threshing_power + organs.separation_power + organs.cleaning_power
    back = load.return_flow / load.shoe_flow
    return np.array([unthreshed, separation, shoe, organs.broken_share, organs.mog_share, back, power])


def follows(trend, values):
    """Whether values over a rising setting go as a sign says."""
    change = np.diff(values)
    if trend == "U":
        least = int(np.argmin(values))
        return 0 < least < len(values) - 1 and bool((change[:least] < 0).all() and (change[least:] > 0).all())
    if trend == "0":
        return bool(np.ptp(values) < 0.25 * np.mean(values))
    return bool((change > 0.0).all() if trend == "+" else (change < 0.0).all())


def drawn(rng):
    """A point: what `steady` takes, and the settings. Drawn evenly over crop, its straw over grain, moistures
    of grain and straw, rotors or walkers, header width, slopes to a tenth, settings within a tenth of the
    manual's, fan within a twentieth, feed 1 to 1.3 of what the machine takes of the crop's straw or grain.
    """
    crop = str(rng.choice(list(STRAW)))
    kind = int(rng.integers(2))
    machine, levels = MACHINES[kind]
    sheet = drivetrain_of(machine)
    ratio = rng.uniform(*STRAW[crop])
    capacity = TAKEN_BARLEY[kind] if crop == "barley" else 1.0
    grain = min(sheet.transport.grain_feed, capacity * sheet.threshing.straw / ratio)
    wet = {name: float(rng.uniform(*WET[name])) for name in WET}
    given = {
        "crop": crop, "levels": levels, "nominal": (grain, ratio * grain), "keys": {"feeder": wet},
        "machine": replace(machine, header_width=float(rng.uniform(5.0, 13.0))),
        "slope": tuple(np.arctan(rng.uniform(-0.1, 0.1, 2))),
    }  # fmt: skip
    here = {name: rng.uniform(0.9, 1.1) for name in TRENDS}
    return given, here | {"feed": rng.uniform(1.0, 1.3), "fan": rng.uniform(0.95, 1.05)}


def judged(rng):
    """Of a drawn point: (setting, quality) -> follows. Walkers have no vanes."""
    given, here = drawn(rng)
    found = {}
    for name, (signs, values) in TRENDS.items():
        if name == "vane" and given["levels"]:
            continue
        table = np.array([steady(**given, **{**here, name: value}) for value in values]).T
        found |= {(name, q): follows(s, row) for q, s, row in zip(QUALITIES, signs, table, strict=True)}
    return found
