"""Messages of chunks that follow each other, in the order of time, with few of them in memory."""

from collections.abc import Iterable, Iterator
from heapq import heappop, heappush
from typing import Any

MIB = 1 << 20
HELD_BYTES = 64 * MIB  # of messages that wait for the next chunk

Found = tuple[Any, Any, int, bytes]  # channel, schema, log time [ns], data


def in_time_order(found: Iterable[Found | int], held_bytes: int = HELD_BYTES) -> Iterator[Found]:
    """Messages by log time; of equal times as they come.

    A number stands before a chunk: nothing after it is earlier than that [ns], so what is goes out. Where no
    number comes, messages come as they are. Where more than `held_bytes` wait, the earliest goes out.
    """
    waiting: list[tuple[int, int, Found]] = []
    held = serial = 0
    is_sorted = False
    for item in found:
        if isinstance(item, int):
            is_sorted = True
            until, most = item, held_bytes
        elif not is_sorted:
            yield item
            continue
        else:
            heappush(waiting, (item[2], serial, item))
            serial, held = serial + 1, held + len(item[3])
            if held <= held_bytes:
                continue
            until, most = -1, held_bytes
        while waiting and (waiting[0][0] < until or held > most):
            first = heappop(waiting)[2]
            held -= len(first[3])
            yield first
    while waiting:
        yield heappop(waiting)[2]
