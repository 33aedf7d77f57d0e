"""How far a run is from its limits.

The margin to a limit is the distance of the value from it, over the distance of the best possible value: 1
at the best value, 0 at the limit, < 0 beyond it, bounded to -1..1. So unlike limits may be compared. The best
value is 0 for an upper bound, 1 for a lower bound on a share, between two bounds their middle, or 0 where it
lies between them. Where a lower bound has no best value, the excess over it is divided by the bound itself.
Some limits are only kept or not: bounds of 0, and a lower bound on the distance driven, where the run ends.
They count only where they fail.
"""

from collections.abc import Mapping
from functools import cache
from math import isfinite, nan
from typing import Any

from swath.judge.catalogue import load_evaluators
from swath.terminal.outcome import NOT_JUDGED

Entry = Mapping[str, Any]
MARGIN = "margin"  # as a metric: that to the nearest limit
ERROR = -2.0  # margin of a run that came to nothing
KEPT_OR_NOT = ("distance_m",)  # whose lower bound is kept or not: it ends with the run


def margin(result: Mapping[str, Any]) -> float:
    """Margin of a run to its nearest limit, -1..1; -1 without a value, -2 for an error."""
    if result["verdict"] == "error":
        return ERROR
    return min((margin_of(entry) for entry in result["expect"]), default=1.0)


def judged_margin(result: Mapping[str, Any], limit: str) -> float:
    """Margin of a run to a limit, or to the nearest; < 0 where it is broken, nan where that is not known."""
    if result["verdict"] == "error" or (not limit and result["verdict"] == NOT_JUDGED):
        return nan
    entries = [entry for entry in result["expect"] if limit in ("", entry["name"])]
    judged = [margin_of(entry) for entry in entries if "rests_outside" not in entry]
    if len(judged) < len(entries) and min(judged, default=1.0) >= 0.0:
        return nan
    return min(judged, default=1.0)


def margin_of(entry: Entry, *, is_bounded: bool = True) -> float:
    """Margin of a value to its limit, as in the entry of a result. is_bounded: to -1..1."""
    value, fails = entry["value"], entry["result"] == "fail"
    if value is None or not isfinite(value):
        return -1.0 if fails else 1.0
    scaled = _scaled(entry["name"], entry["limit"], float(value))
    if scaled is None:
        return -1.0 if fails else 1.0
    found = min(1.0, max(-1.0, scaled)) if is_bounded else scaled
    return min(found, -1e-9) if fails else max(found, 0.0)


def is_kept_or_not(entry: Entry) -> bool:
    """Whether a limit has no margin."""
    return _scaled(entry["name"], entry["limit"], 0.0) is None


def _scaled(name: str, limit: Mapping[str, Any], value: float) -> float | None:
    """The margin before it is bounded; None for a limit that is only kept or not."""
    low, high = limit.get("min"), limit.get("max")
    if name in KEPT_OR_NOT and high is None:
        return None
    hold = limit.get("hold")
    if isinstance(hold, int | float) and not isinstance(hold, bool):  # the value is a share of the time
        return (value - hold) / (1.0 - hold) if hold < 1.0 else None
    if low is not None and high is not None:
        best = 0.0 if low < 0.0 < high else 0.5 * (low + high)
        return min(_share(value, low, best), _share(value, high, best)) if low < high else None
    if high is not None:
        return _share(value, high, 0.0) if high > 0.0 else _own_measure(high - value, high)
    if low is not None:
        return _share(value, low, 1.0) if _is_share(name) and low < 1.0 else _own_measure(value - low, low)
    return None


def _share(value: float, bound: float, best: float) -> float:
    """1 at the best value, 0 at the bound."""
    return (bound - value) / (bound - best)


def _own_measure(left: float, bound: float) -> float | None:
    return left / abs(bound) if bound else None


@cache
def _is_share(name: str) -> bool:
    """Whether a metric is a share, 1 at most."""
    found = load_evaluators().metrics.get(name)
    return found is not None and found.unit == "1" and found.better == "higher"
