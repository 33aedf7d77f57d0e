"""What a minute of a recording takes, topic by topic: python benchmarks/recording.py RUN [OTHER].

RUN: the folder of a run; OTHER: a second one beside it, such as the same run by another version. A topic's
messages are compressed by themselves here, in blocks of the size of a chunk, by the file's own level; what
topics share in a chunk makes the file smaller than the sum, heads of messages and the index make it larger.
"""

import argparse
import sys
from collections import Counter, defaultdict
from collections.abc import Sequence
from pathlib import Path

from swath.record.mcap_file import CHUNK_BYTES, LEVEL
from swath.record.recorder import RECORDING_FILE, TRACKS_FILE
from swath.terminal.tables import table as print_table

KB = 1e3
WHOLE = "run.mcap, the whole file"


def topics(folder: Path) -> dict[str, tuple[float, float]]:
    """(kB, kB compressed) per simulated minute of every topic and file of a run."""
    import zstandard
    from mcap.reader import make_reader

    path = folder / RECORDING_FILE
    parts: dict[str, list[bytes]] = defaultdict(list)
    packed: Counter[str] = Counter()
    whole: Counter[str] = Counter()
    last = 1

    def pack(topic: str) -> None:
        data = b"".join(parts.pop(topic))
        whole[topic] += len(data)
        packed[topic] += len(zstandard.compress(data, LEVEL))

    with path.open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages():
            parts[channel.topic].append(message.data)
            last = max(last, message.log_time)
            if sum(map(len, parts[channel.topic])) > CHUNK_BYTES:
                pack(channel.topic)
    for topic in list(parts):
        pack(topic)
    minutes = last / 60e9
    found = {topic: (whole[topic] / KB / minutes, packed[topic] / KB / minutes) for topic in whole}
    for name, file in ((WHOLE, path), (TRACKS_FILE, folder / TRACKS_FILE)):
        size = file.stat().st_size / KB / minutes
        found[name] = size, size
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split(":")[0])
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN")
    runs = [topics(folder) for folder in parser.parse_args(arguments).runs]
    names = sorted(runs[0], key=lambda topic: -runs[0][topic][1])
    rows = [[name, *(f"{v:.1f}" for run in runs for v in run.get(name, (0.0, 0.0)))] for name in names]
    print_table("kB per simulated minute", ["topic", *["kB", "compressed"] * len(runs)], rows)


if __name__ == "__main__":
    sys.exit(main())
