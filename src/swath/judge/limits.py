"""Whether limits hold: on metrics, and on samples of the tracks, in the whole run or in windows of it.

The result of a limit is a mapping as it stands in `summary.json` under `expect`: `subject` (a machine or
`field`), `name`, `limit` (the keys min, max, hold, while), `window`, `value`, `result` (pass, fail or
not measured) and, where it does not pass, the `reason`.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from swath.core.number_text import num
from swath.judge.evaluator import Event
from swath.judge.windows import Window
from swath.scenario.resolved import Expectation
from swath.scenario.sections import Bounds, Limit
from swath.signals import F64
from swath.terminal.outcome import exit_code, result_of

Outcome = tuple[float | None, str]  # value, and why it fails, "" where it passes
NOTHING = "nothing was measured"
OF_WINDOWS = ("distance_m", "t_s")  # columns of the tracks that say when a window is open
NO_SAMPLE = "the window never opened: no sample lies in it"


def exit_code_of(expect: Sequence[Mapping[str, Any]]) -> int:
    """0 all limits pass, 1 one fails, 3 none fails but one was not measured, or not judged."""
    return exit_code(map(result_of, expect))


def window_of(limit: Limit) -> Window:
    """The window that a limit is set in."""
    to_m, to_s = (limit.within_m, limit.within_s) if limit.after or limit.before else (limit.to_m, limit.to_s)
    return Window(limit.from_m, to_m, limit.from_s, to_s, limit.after or "", limit.before or "")


def entry_of(expected: Expectation, outcomes: Sequence[Outcome], *, is_trial: bool = False) -> dict[str, Any]:
    """The entry of a limit: it passes when it does in every stretch of its window; the worst one counts.

    is_trial: of a run that was to end before anything is measured: what is not measured then does not fail
    """
    limit = expected.limit
    value, reason = next((o for o in outcomes if o[1]), outcomes[-1] if outcomes else (None, ""))
    if not outcomes:
        kind = limit.after or limit.before
        reason = f"the window never opened: there was no event {kind}"
    entry: dict[str, Any] = {"subject": expected.subject, "name": expected.name, "limit": limit.rule}
    if limit.window:
        entry["window"] = limit.window
    failed = "not measured" if is_trial and reason in (NOTHING, NO_SAMPLE) else "fail"
    entry |= {"value": value, "result": failed if reason else "pass"}
    return entry | {"reason": reason} if reason else entry


def check_metric(bounds: Bounds, value: Any) -> Outcome:
    """A metric against its bounds; one that is missing, null or not finite fails."""
    if not isinstance(value, int | float) or isinstance(value, bool) or not np.isfinite(value):
        return None, NOTHING
    return value, _outside(bounds, float(value))


def check_samples(limit: Limit, tracks: Mapping[str, F64], name: str, event: Event | None) -> Outcome:
    """A column of the tracks of a machine against its bounds, in one stretch of the limit's window.

    Samples without a value do not count. The value is the worst sample (always), the best one (eventually) or
    the share of the samples within the bounds; samples come at a fixed rate, so that is a share of the time.
    """
    unknown = [c for c in (name, *limit.while_) if c not in tracks]
    if unknown:
        return None, f"the machine has no column {', '.join(unknown)}"
    distance, t = (tracks[c] for c in OF_WINDOWS)
    chosen = np.array(window_of(limit).inside(event, distance, t), dtype=bool)
    if not chosen.any():
        return None, NO_SAMPLE
    for column, bounds in limit.while_.items():
        chosen &= _distance_outside(bounds, tracks[column]) <= 0.0
    if not chosen.any():
        return None, f"there was no sample at which {' and '.join(limit.while_)} was as `while` asks"
    values = tracks[name][chosen & np.isfinite(tracks[name])]
    if not len(values):
        return None, NOTHING
    outside = _distance_outside(limit, values)
    if limit.hold == "always":
        worst = float(values[np.argmax(outside)])
        return worst, _outside(limit, worst)
    if limit.hold == "eventually":
        best = float(values[np.argmin(outside)])
        return best, _outside(limit, best) and f"never within the bounds, nearest {num(best)}"
    share, wanted = float(np.mean(outside <= 0.0)), float(limit.hold or 1.0)
    return share, f"{num(share)} of the time, expected {num(wanted)}" if share < wanted else ""


def _distance_outside(bounds: Bounds, values: F64) -> F64:
    """How far values are outside of bounds, <= 0 inside; nan counts as outside."""
    below = (-np.inf if bounds.min is None else bounds.min) - values
    above = values - (np.inf if bounds.max is None else bounds.max)
    return np.nan_to_num(np.maximum(below, above), nan=np.inf, neginf=-np.inf)


def _outside(bounds: Bounds, value: float) -> str:
    """What is wrong with a value, "" where it is within the bounds."""
    if bounds.min is not None and value < bounds.min:
        return f"{num(value)} is less than {num(bounds.min)}"
    if bounds.max is not None and value > bounds.max:
        return f"{num(value)} is more than {num(bounds.max)}"
    return ""
