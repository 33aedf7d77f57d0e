"""How losses, quality and power of a combine go with its settings: what is published, and a row of organs."""

from types import SimpleNamespace

import numpy as np

from swath.core.schedule import NS
from swath.signals import OrganSettings
from swath.signals.settings import own_settings
from tests.machine.machine_fakes import STREAM, Ground, site
from tests.machine.process_rig import Row, flow, state

QUALITIES = ("unthreshed", "separation", "shoe loss", "broken", "tank MOG", "returns", "power")
# With a setting that goes up: + and - monotone, U an inner least, 0 within a quarter (John Deere OMDXE11330,
# New Holland CR manual, section 6; U of separation and what these do not say: estimates).
# Ranges are over the manual's settings.
TRENDS = {
    "drum": ("-U+++U+", np.linspace(0.7, 1.25, 7)),
    "concave": ("+U---U-", np.linspace(0.6, 1.8, 7)),
    "fan": ("00U0-++", np.linspace(0.8, 1.3, 7)),
    "upper": ("00U0++0", np.linspace(0.6, 2.0, 7)),
    "lower": ("000-+-0", np.linspace(0.7, 2.5, 7)),
    "vane": ("++0--0-", np.linspace(0.6, 1.5, 7)),
    "feed": ("++U-+++", np.linspace(0.6, 1.3, 8)),
}
FLOW = 23.8, 15.4  # nominal grain and straw [kg/s]
STEP, STEPS = NS // 2, 60


def steady(crop="wheat", keys=(), feed=1.0, levels=(), machine=None, nominal=FLOW, **over_own):
    """What `QUALITIES` come to: shares of grain fed, on the shoe, to the tank, of the shoe's flow, and W.

    nominal: grain and straw at feed 1 [kg/s]; over_own: settings over those of the manual
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
        made = row.step(
            k * STEP, STEP, {"flow": (flow(k, grain, straw, h),), "state": state(k, 1.0 * k, 2.0)}
        )
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


def judged(rng):
    """Of a drawn point, feed 1 to 1.3, settings within 5 %, the fan within 2: (setting, quality) -> follows.

    With more air than that, grain is blown out, and more on the sieves keeps it in.
    """
    here = {name: rng.uniform(0.95, 1.05) for name in TRENDS}
    here |= {"feed": rng.uniform(1.0, 1.3), "fan": rng.uniform(0.98, 1.02)}
    found = {}
    for name, (signs, values) in TRENDS.items():
        table = np.array([steady(**{**here, name: value}) for value in values]).T
        found |= {(name, q): follows(s, row) for q, s, row in zip(QUALITIES, signs, table, strict=True)}
    return found
