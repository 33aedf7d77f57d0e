"""Where a device is: `protocol[+transport]://[host][:port][/path][?option=value&...]`.

Without a host it is this machine alone (127.0.0.1): to be heard, or to listen, elsewhere an address must be
named, by the user himself (`swath.core.foreign_code`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from ipaddress import ip_address
from typing import Any
from urllib.parse import parse_qsl, urlsplit

from swath.core.errors import InputError
from swath.core.foreign_code import need_named
from swath.core.typed_numbers import number_in, unit_of
from swath.documents.validation import unknown_key

LOOPBACK = "127.0.0.1"


@dataclass(frozen=True)
class Address:
    """protocol: such as `lms`; transport: tcp, udp or pty; path: of a pseudo terminal, without a port."""

    text: str
    protocol: str
    transport: str
    host: str
    port: int
    path: str = ""
    options: Mapping[str, str] = field(default_factory=dict)

    def __str__(self) -> str:
        plain = {"lms": "tcp", "velodyne": "udp", "agopengps": "udp", "analog": "udp"}.get(self.protocol)
        name = self.protocol if self.transport == plain else f"{self.protocol}+{self.transport}"
        return f"{name}://{self.path}" if self.path else f"{name}://{self.host}:{self.port}"

    def number(self, name: str, default: float, low: float, high: float) -> float:
        """An option that is a number. InputError where it is none, or not within bounds."""
        text, expected = self.options.get(name), f"expected {name} to be a number from {low:g} to {high:g}"
        try:
            value = default if text is None else number_in(text, unit_of(name))
        except ValueError as error:
            raise InputError("device", self.text, f"{expected}{error}") from None
        if not low <= value <= high:
            raise InputError("device", self.text, expected)
        return value

    def choice(self, name: str, allowed: Sequence[str]) -> str:
        """An option that is one of several names, the first without it. InputError."""
        value = self.options.get(name, allowed[0])
        if value not in allowed:
            raise InputError("device", self.text, f"expected {name} to be one of {', '.join(allowed)}")
        return value

    def known(self, names: Sequence[str], key: str = "device") -> "Address":
        """The same. InputError where it has another option than these."""
        for name in self.options:
            if name not in names:
                raise InputError(key, self.text, unknown_key(name, names))
        return self


def read_address(
    text: str, protocols: Mapping[str, tuple[Sequence[str], int]], key: str = "device", *, said: str = ""
) -> Address:
    """An address that may be opened. InputError, and NotNamed where it leads on without being named.

    protocols: name -> (its transports, the usual one first; its usual port); said: as the user wrote it
    """

    def wrong(expected: str) -> InputError:
        return InputError(key, text, expected)

    try:
        parts = urlsplit(text)
        port: Any = parts.port
        options = dict(parse_qsl(parts.query, keep_blank_values=True, strict_parsing=bool(parts.query)))
    except ValueError:
        raise wrong("expected protocol://host:port") from None
    name, _, transport = parts.scheme.partition("+")
    if name not in protocols or "://" not in text:
        forms = ", ".join(f"{n}://" for n in protocols)
        raise wrong(f"expected {forms} with host and port")
    transports, usual = protocols[name]
    transport = transport or transports[0]
    if transport not in transports:
        raise wrong(f"expected {' or '.join(f'{name}+{t}://' for t in transports)}")
    if transport == "pty":
        path = (parts.netloc + parts.path).strip()
        if not path or parts.port is not None:
            raise wrong(f"expected {name}+pty://PATH, where the link to the pseudo terminal is to be")
        need_named(key, said or text)
        return Address(text, name, transport, "", 0, path, options)
    if parts.path not in ("", "/") or parts.username is not None or parts.fragment:
        raise wrong("expected protocol://host:port and nothing behind but ?option=value")
    host = parts.hostname or LOOPBACK
    if not is_loopback(host):
        need_named(key, said or text)
    return Address(text, name, transport, host, usual if port is None else port, "", options)


def is_loopback(host: str) -> bool:
    """Whether a host is this machine alone, whatever names resolve to."""
    try:
        return host == "localhost" or ip_address(host).is_loopback
    except ValueError:
        return False
