"""Cutting runs of frames into the parts that are recorded as one clip each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence


def cut_run(
    run: Sequence[int], length: int, *, history: int, unroll: int
) -> Iterator[tuple[Sequence[int], int]]:
    """Cut one unbroken run into parts of about `length` frames.

    Parts overlap by history and all but one target of a sample, so that every sample lies in
    exactly one, with the history that there is. Yields numbers and the position of the first
    target.

    Args:
        run: numbers of its frames, ascending.
        length: of a part, in frames.
        history: frames that go before a target.
        unroll: successive targets of a sample.
    """
    overlap = history + unroll - 1
    length = max(overlap + 1, length)
    for start in range(0, len(run), length):
        first = max(0, start - overlap)
        yield run[first : start + length], max(0, start - first - unroll + 1)
