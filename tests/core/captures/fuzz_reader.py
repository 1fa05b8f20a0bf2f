"""Reads damaged copies of an EXR file and reports on stdout; run as a process of its own.

Usage: fuzz_reader.py FOLDER SEED CASES, where FOLDER holds intact files.
"""

from __future__ import annotations

import json
import random
import resource
import sys
import time
from collections import Counter
from pathlib import Path

from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.exr import read_channels, read_header

ADDRESS_SPACE = 4 << 30
HEADER_BYTES = 1200


def damaged(content: bytes, rng: random.Random, kind: int) -> bytes:
    """0: cut short; 1: bytes of the header or chunk table changed; 2: bytes anywhere changed."""
    if kind == 0:
        return content[: rng.randrange(len(content))]
    spoilt = bytearray(content)
    end = min(HEADER_BYTES, len(content)) if kind == 1 else len(content)
    for _ in range(rng.choice((1, 1, 2, 4))):
        spoilt[rng.randrange(end)] = rng.randrange(256)
    return bytes(spoilt)


def read_all(path: Path) -> str:
    """Read header and pixels; return what became of it."""
    try:
        read_channels(path, read_header(path).channels)
    except FrameFolderError as error:
        message = str(error)
        assert message.startswith(str(path)), message
        assert "\n" not in message, message
        return "refused"
    return "read"


def peak_bytes() -> int:
    """Return the most memory this program has held.

    Not `ru_maxrss`, which a forked process inherits from the one that started it.
    """
    status = Path("/proc/self/status").read_text(encoding="ascii")
    line = next(line for line in status.splitlines() if line.startswith("VmHWM:"))
    return int(line.split()[1]) * 1024


def main() -> None:
    """Run the cases and print one JSON object."""
    folder, seed, cases = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
    originals = [path.read_bytes() for path in sorted(folder.glob("*.exr"))]
    target = folder / "damaged.part"
    rng = random.Random(seed)
    ends: Counter[str] = Counter()
    slowest = 0.0
    for case in range(cases):
        target.write_bytes(damaged(rng.choice(originals), rng, case % 3))
        started = time.perf_counter()
        ends[read_all(target)] += 1
        slowest = max(slowest, time.perf_counter() - started)
    found = {"ends": ends, "slowest_s": slowest, "peak_bytes": peak_bytes()}
    sys.stdout.write(json.dumps(found) + "\n")


if __name__ == "__main__":
    main()
