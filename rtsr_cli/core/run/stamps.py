"""Stamps of a shot's outputs: what tells a finished file from a stale one.

A stamp is a hash of everything that decides an output's bytes: the run's settings (`config_hash`),
and files and camera of every frame that the output depends on, from the last reset of history on.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from rtsr_cli.core.errors import RtsrError
from rtsr_cli.core.files.provenance import FileDigests, digest_values
from rtsr_cli.core.run.shot_inputs import ShotInputs

UNREADABLE = "unreadable"
"""Stands in the stamps for the content of a file that could not be read."""


@dataclass(frozen=True, kw_only=True)
class Stamps:
    """Stamps of a shot's outputs.

    Attributes:
        inputs: of the shot.
        digests: of its files.
        numbers: of every frame, in order.
        starts: for each output the first frame that it depends on.
        config_hash: of settings, declarations and version.
    """

    inputs: ShotInputs
    digests: FileDigests
    numbers: tuple[int, ...]
    starts: Mapping[int, int]
    config_hash: str
    _position: dict[int, int] = field(init=False, repr=False)
    _inputs: dict[int, str] = field(init=False, repr=False, default_factory=dict)
    _chains: dict[tuple[int, int], str] = field(init=False, repr=False, default_factory=dict)

    def __post_init__(self) -> None:
        """Prepare; nothing is read yet."""
        object.__setattr__(self, "_position", {n: i for i, n in enumerate(self.numbers)})

    def of_output(self, number: int) -> str:
        """Return the stamp of one output."""
        return digest_values(self.config_hash, self._chain(self.starts[number], number))

    def _chain(self, start: int, number: int) -> str:
        """Hash of the frames from `start` to `number`; the longest known one is gone on with."""
        numbers = self.numbers
        first, last = self._position[start], self._position[number]
        begin = last
        # where every other frame is asked for, those between them are in no chain of their own
        while begin > first and (start, numbers[begin - 1]) not in self._chains:
            begin -= 1
        chain = self._chains[start, numbers[begin - 1]] if begin > first else ""
        for n in numbers[begin : last + 1]:
            chain = digest_values(chain, self.of_input(n))
        self._chains[start, number] = chain
        return chain

    def of_input(self, number: int) -> str:
        """Hash a frame's files and camera; a file that cannot be read hashes as such."""
        if number not in self._inputs:
            camera = self.inputs.reader.camera_values(number)
            try:
                content = self.digests.of_all(self.inputs.files(number))
            except RtsrError:
                content = UNREADABLE
            self._inputs[number] = digest_values(content, camera)
        return self._inputs[number]

    def spoil(self, number: int) -> None:
        """Count a frame that changed under the run as unreadable, whatever it holds by now."""
        self._inputs[number] = digest_values(UNREADABLE, number)
