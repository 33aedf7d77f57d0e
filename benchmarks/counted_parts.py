"""Instructions below single functions of a program that Callgrind counts.

Callgrind knows functions of C. `Parts.count` sends the calls of a Python function through a few bytes of
machine code of their own; what Callgrind finds below the call in them is what the function took. Linux on
x86-64.
"""

import ctypes
import functools
import mmap
import re
from pathlib import Path
from typing import Any

PAGE, STUB = 4096, 64  # bytes of all stubs, of each
CALL = 14  # of a stub, up to and with its call
CALLS = re.compile(r"^calls=(\d+) .*\n(0x[0-9a-f]+) \S+ (\d+)$", re.MULTILINE)
WITHIN = ": "  # between the name of a part and that of a part of it
NOTHING, LOOP, ROUNDS = "(nothing)", "(loop)", 500  # what it takes to count a call is counted so


class Parts:
    """Functions whose instructions are counted, by name; `a: b` is a part of a. Several may have one name."""

    def __init__(self) -> None:
        self._code = mmap.mmap(-1, PAGE, prot=mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC)
        self._first = ctypes.addressof(ctypes.c_char.from_buffer(self._code))
        self._calls: dict[str, Any] = {}

    def count(self, owner: Any, attribute: str, name: str) -> None:
        """Count a method of an object or class, under a name."""
        call, function = self._calls.get(name) or self._stub(name), getattr(owner, attribute)

        @functools.wraps(function)
        def counted(*args: Any, **more: Any) -> Any:
            return call(function, args, more)

        is_bound = getattr(function, "__self__", None) is owner
        setattr(owner, attribute, staticmethod(counted) if is_bound else counted)

    def count_counting(self) -> None:
        """Call what does nothing, while Callgrind counts: so much is too much for every call in a part."""
        self.nothing = self.loop = lambda *_: None
        self.count(self, "nothing", NOTHING)

        def loop() -> None:
            nothing = self.nothing
            for _ in range(ROUNDS):
                nothing(self, 0, self)

        self.loop = loop
        self.count(self, "loop", LOOP)
        self.loop()

    def write(self, file: Path) -> None:
        """The addresses of the calls, for `read_counts`."""
        places = (f"{self._place(number) + CALL} {name}\n" for number, name in enumerate(self._calls))
        file.write_text("".join(places))

    def _place(self, number: int) -> int:
        return self._first + STUB * number

    def _stub(self, name: str) -> Any:
        """`PyObject_Call` by sub rsp,8; mov rax,target; call rax; add rsp,8; ret."""
        number, target = len(self._calls), ctypes.cast(ctypes.pythonapi.PyObject_Call, ctypes.c_void_p).value
        assert target is not None
        assert number < PAGE // STUB
        code = b"\x48\x83\xec\x08\x48\xb8" + target.to_bytes(8, "little") + b"\xff\xd0\x48\x83\xc4\x08\xc3"
        self._code[number * STUB : number * STUB + len(code)] = code
        kind = ctypes.PYFUNCTYPE(*[ctypes.py_object] * 4)
        self._calls[name] = kind(self._place(number))
        return self._calls[name]


def read_counts(places: Path, text: str) -> dict[str, tuple[int, float]]:
    """(calls, instructions) by name, less what counting took. text: what Callgrind wrote, with addresses."""
    rows = (line.split(" ", 1) for line in places.read_text().splitlines())
    wanted = {int(place): name for place, name in rows}
    found = dict.fromkeys(wanted.values(), (0, 0.0))
    for calls, place, spent in CALLS.findall(text):
        if name := wanted.get(int(place, 16)):
            before = found[name]
            found[name] = before[0] + int(calls), before[1] + int(spent)
    (count, nothing), (_, loop) = found.pop(NOTHING), found.pop(LOOP)
    each = (loop - nothing) / count

    def calls_in(name: str) -> int:
        return sum(calls for part, (calls, _) in found.items() if part.startswith(name + WITHIN))

    return {name: (calls, spent - each * calls_in(name)) for name, (calls, spent) in found.items()}
