"""Files damaged in the ways that transfers, full disks and bad programs do, and what a reader makes of each:
a result, or one line that says what is wrong; soon, and in the memory that the file itself justifies."""

import re
import resource
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

EXTREMES = [0, 1, 0x7F, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF, 2**63 - 1, 2**64 - 1]
"""What counts, lengths and offsets become."""
WORDS = [b"", b"nan", b"\x00", b"\xff\xfe", b"[[[[", b"</a>", b"\n", b"x" * 5000]
DIGITS = [
    b"",
    b"0",
    b"-1",
    b"1e308",
    b"-inf",
    b"nan",
    b"4294967295",
    b"9" * 20,
    b"9" * 400,
    b"0.5",
    b"2",
    b"x",
]
"""What text and numbers in text become."""
LONGEST_S = 5.0
"""Of processor time for one file, which takes milliseconds; how busy the machine is does not count."""
MOST_BYTES = 2 << 30
"""What a reader may ask for beyond what the process has."""


def damaged(data: bytes, cases: int, seed: int = 0) -> Iterator[bytes]:
    """`cases` files: cut off, with flipped bits, with extreme numbers in bytes and in digits, with parts that
    are missing, double or moved, and with other text."""
    random = np.random.default_rng(seed)
    numbers = [found.span() for found in re.finditer(rb"-?[0-9][0-9.]*", data)]

    def place(length: int = 0) -> int:
        # Half of them near the beginning, where the headers are.
        most = max(1, len(data) - length)
        return int(random.integers(min(most, 256) if random.random() < 0.5 else most))

    for case in range(cases):
        kind = case % (7 if numbers else 6)
        if kind == 0:
            yield data[: place()]
        elif kind == 1:
            changed = bytearray(data)
            for _ in range(int(random.integers(1, 9))):
                changed[place(1)] ^= 1 << int(random.integers(8))
            yield bytes(changed)
        elif kind == 2:
            size = int(random.choice([1, 2, 4, 8]))
            number = int(EXTREMES[int(random.integers(len(EXTREMES)))]) % 256**size
            at = place(size)
            order = "little" if random.random() < 0.8 else "big"
            yield data[:at] + number.to_bytes(size, order) + data[at + size :]
        elif kind == 3:
            at, length = place(), int(random.integers(1, 64))
            yield data[:at] + data[at + length :]
        elif kind == 4:
            at, to, length = place(), place(), int(random.integers(1, 64))
            yield data[:to] + data[at : at + length] + data[to:]
        elif kind == 5:
            at, length = place(), int(random.integers(1, 12))
            yield data[:at] + WORDS[int(random.integers(len(WORDS)))] + data[at + length :]
        else:
            begin, end = numbers[int(random.integers(len(numbers)))]
            yield data[:begin] + DIGITS[int(random.integers(len(DIGITS)))] + data[end:]


@contextmanager
def bounded_memory() -> Iterator[None]:
    """Whoever asks for `MOST_BYTES` more than the process has gets a MemoryError."""
    with open("/proc/self/statm") as file:
        held = int(file.read().split()[0]) * resource.getpagesize()
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (held + MOST_BYTES, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def outcome(read: Callable[[], object]) -> str:
    """The one line in which `read` refuses what it is given, or "" for a result; anything else fails."""
    begin = time.process_time()
    try:
        with bounded_memory():
            read()
        said = ""
    except (ValueError, OSError) as error:
        said = str(error)
        assert said and "\n" not in said and len(said) < 1000, f"{type(error).__name__}: {said!r}"
        assert "MemoryError" not in said and "allocate" not in said, said
    assert time.process_time() - begin < LONGEST_S
    return said
