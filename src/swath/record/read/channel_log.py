"""MF4, BLF and ASC as a recording: each channel is a topic of plain numbers in SI units.

Latitude and longitude, where the log has them, are also the topic POSITION of NavSatFix.
"""

from collections.abc import Collection, Iterator
from itertools import groupby
from math import nan
from operator import itemgetter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from swath.core.units import DEG
from swath.field_io.logs.channels import Channels, si_unit
from swath.field_io.logs.held import Chosen, known_names

KIND = "channel "  # before the unit of a channel, as the type of its topic
POSITION, POSITION_TYPE = "position", "sensor_msgs/msg/NavSatFix"


class ChannelLog:
    """Reads a measurement as a recording; notes as of McapLog.

    A name that several sources say is a topic, too, of the one that counts.
    """

    def __init__(self, channels: Channels) -> None:
        self.path: Path = channels.path
        self._channels = channels
        self._factors: dict[str, float] = {}
        self._topics: dict[str, str] = {}
        units = {**{name: channels.units[of[0]] for name, of in channels.sources.items()}, **channels.units}
        for name, unit in units.items():
            symbol, self._factors[name] = si_unit(unit) or (unit, 1.0)
            self._topics[name] = f"{KIND}{symbol}"
        self._keys = {name: key for key, name in known_names(channels).items()}
        self._chosen = Chosen()
        places = {name: k for name, k in self._keys.items() if k in ("lat", "lon", "elevation")}
        angles = [name for name in places if self._topics[name] == f"{KIND}rad"]
        self._place = places if len(angles) == 2 and POSITION not in self._topics else {}
        if self._place:
            self._topics[POSITION] = POSITION_TYPE

    @property
    def notes(self) -> dict[str, int]:
        """What was assumed or could not be read, with how often."""
        return {**self._channels.notes, **dict.fromkeys(self._chosen.notes, 1)}

    def forget_notes(self) -> None:
        """What is noted on opening stays."""

    def topics(self) -> dict[str, str]:
        """Topic -> type: `channel` and its unit."""
        return dict(self._topics)

    def begin(self) -> int:
        """Time of the first sample [ns]."""
        return self._channels.begin

    def end(self) -> int:
        """Time of the last sample [ns]."""
        return self._channels.end

    def messages(self, wanted: Collection[str], also_first: str = "") -> Iterator[tuple[str, int, Any]]:
        """(topic, time [ns], message) of some topics, and the first one of another, in the order of time."""
        rest = {also_first} - {""}
        place = self._place if POSITION in {*wanted, *rest} else {}
        asked = ({*wanted} | rest | place.keys()) & self._factors.keys()
        into: dict[str, list[tuple[str, float]]] = {}
        new = {name: self._keys.get(name, name) for name in sorted(asked - self._chosen.parts.keys())}
        self._chosen.add(self._channels, new, lambda key, source: f"topic {source}")
        for name in sorted(asked):
            for part, factor in self._chosen.of(name).items():
                into.setdefault(part, []).append((name, factor * self._factors[name]))
        at: dict[str, float] = {}
        for t, of_t in groupby(self._channels.samples(into) if into else (), key=itemgetter(0)):
            found: list[tuple[str, Any]] = []
            for _, part, number in of_t:
                for name, factor in into[part]:
                    found.append((name, SimpleNamespace(data=number * factor)))
                    if name in place:
                        at[place[name]] = number * factor
            if {"lat", "lon"} <= at.keys():  # with the elevation of their time, in any order
                found.append((POSITION, _fix(at)))
                at = {k: v for k, v in at.items() if k == "elevation"}
            for topic, message in found:
                if topic in wanted or topic in rest:
                    rest.discard(topic)
                    yield topic, t, message
            if not wanted and not rest:
                return

    def attachment(self, name: str) -> bytes | None:
        """A measurement has none."""
        return None


def _fix(at: dict[str, float]) -> SimpleNamespace:
    """What a NavSatFix says, of lat, lon [rad] and elevation [m]; the log does not say how exact it is."""
    return SimpleNamespace(
        latitude=at["lat"] / DEG, longitude=at["lon"] / DEG, altitude=at.get("elevation", nan),
        status=SimpleNamespace(status=0), position_covariance_type=0,
    )  # fmt: skip
