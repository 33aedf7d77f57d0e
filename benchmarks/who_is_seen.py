"""Who is seen: a person standing and lying, a fawn and a hare, by each sensor, through day and night.

python -m benchmarks.who_is_seen [--hours 4 7 13.5 22] [--places -1 3]

Shares of looks that detect, as `swath reda` counts them: on stubble 5 m ahead of the sensors (-1), and 3 m
inside wheat of 0.85 m, 9 m ahead. LiDAR and radars know neither light nor warmth: one column for all hours.
"""

import argparse

from swath.tools.reda.scene import SENSORS, Condition, Scene, Settings, make_sensor

TARGETS = ("person", "person-lying", "animal-fawn", "animal-hare")
BY_HOUR = ("camera", "thermal")


def share(target: str, sensor: str, hour: float, inside: float, repeats: int = 2) -> tuple[float, str]:
    """Share of the looks that detect, and why."""
    settings = Settings(target=target, hours=(hour,), sensors=(sensor,), repeats=repeats)
    found = make_sensor(sensor, Scene(settings, Condition(0.85, 400.0, "clear", hour))).look(inside, 0.0)
    return found.detected, found.why


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hours", nargs="+", type=float, default=[4.0, 7.0, 9.0, 13.5, 20.0, 23.0])
    parser.add_argument("--places", nargs="+", type=float, default=[-1.0, 3.0])
    args = parser.parse_args()
    for inside in args.places:
        print(f"\n{'on stubble' if inside < 0 else f'{inside:g} m in the crop'}: share of looks, by hour")
        hours = "".join(f"{h:>7g} h" for h in args.hours)
        print(f"{'target':14}{'sensor':20}{hours}  why (last hour)")
        for target in TARGETS:
            for sensor in SENSORS:
                found = [
                    share(target, sensor, h, inside)
                    for h in (args.hours if sensor in BY_HOUR else args.hours[:1])
                ]
                shown = [f"{s:9.2f}" for s, _ in found] + [" " * 9] * (len(args.hours) - len(found))
                print(f"{target:14}{sensor:20}{''.join(shown)}  {found[-1][1]}", flush=True)


if __name__ == "__main__":
    main()
