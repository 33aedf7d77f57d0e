"""A combine's turns and a day of it against what was measured: the rows of docs/how-to/fleet.md.

SWATH_DATA=... python -m benchmarks.harvest
"""

from benchmarks.recorded_day import predict, read_day
from tests.fleet import measured_turns as turns
from tests.fleet.test_recorded import LIMITS, LOG


def say(case: str, found: str, expected: str) -> None:
    """One row."""
    print(f"{case:58s} {found:30s} {expected}", flush=True)


def headland_turns() -> None:
    """40 rolling turns made anew, each at its own shift, speed and excursion."""
    measured = turns.rolling_turns()
    stated = turns.medians([t.figures for t in measured])
    for made in (turns.in_closed_loop, turns.with_clothoids, turns.rolled_through):
        for antenna in (turns.ANTENNA, 1.0, 2.5) if made is turns.in_closed_loop else (turns.ANTENNA,):
            found = turns.medians([turns.driven_by(made, t, antenna)[0] for t in measured])
            for key in ("duration", "path", "depth"):
                off = 100.0 * (found[key] / stated[key] - 1.0)
                name = made.__name__.replace("_", " ")
                say(f"turns {name}, antenna {antenna:g} m, {key}", f"{found[key]:.2f} ({off:+.1f} %)",
                    f"{stated[key]:.2f}")  # fmt: skip
    dubins = turns.dubins_length(11.9, 6.1)
    say("Dubins turn of 6.1 m", f"{dubins:.1f} m ({100 * (dubins / 31.55 - 1):+.0f} %)", "31.6 m, 27 % short")


def recorded_day() -> None:
    """The first day of the 2014 log."""
    day = read_day(LOG, LIMITS)
    for known in (1, 2, 3):
        made = predict(day, 3600.0 * known)
        for name, found, stated in (
            ("cutting", made.cutting, made.cutting_recorded),
            ("between passes", made.turning, made.turning_recorded),
            ("in all", made.total, made.total_recorded),
        ):
            off = 100.0 * (found / stated - 1.0)
            say(
                f"2014, {known} h known, {name}",
                f"{found / 3600:.2f} h ({off:+.1f} %)",
                f"{stated / 3600:.2f} h",
            )


if __name__ == "__main__":
    headland_turns()
    recorded_day()
