"""`manifest.json` of an exported network: what each file takes and gives, and what is around it."""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

from rtsr_cli.core.documents import DocumentError, parse_json, read_text
from rtsr_cli.core.errors import CheckpointError
from rtsr_cli.core.shapes import Size

MANIFEST = "manifest.json"

FORMAT = "rtsr-export-2"

OLDER = ("rtsr-export-1",)
"""Formats of before manifests had a checksum."""

CHECKSUM = "checksum"
"""`sum_manifest`."""

FACTS: Mapping[str, type] = {
    "system": str,
    "scale": int,
    "config": dict,
    "graphs": list,
    "values": dict,
    "weights": dict,
}
"""What a manifest has to say for its files to be run."""

GRAPH_FACTS: Mapping[str, type] = {"method": str, "file": str, "sha256": str, "multiple": int}


@dataclass(frozen=True, kw_only=True)
class ExportedFile:
    """A graph's file.

    Attributes:
        method: of the network that it stands for.
        path: of the file.
        sha256: of its content.
        multiple: LR pixels that sides have to be a multiple of; 1 where frames are filled up.
    """

    method: str
    path: Path
    sha256: str
    multiple: int


@dataclass(frozen=True, kw_only=True)
class Manifest:
    """What is needed to run exported files.

    Attributes:
        path: of the manifest.
        system: name.
        scale: S.
        config: the system's settings as plain values.
        files: graphs.
        values: buffers of the network that steps outside read.
        about: what the weights say of their training.
        size: (height, width) of the LR frames that the files take; None = any.
    """

    path: Path
    system: str
    scale: int
    config: Mapping[str, Any]
    files: Sequence[ExportedFile]
    values: Mapping[str, Any]
    about: Mapping[str, Any]
    size: Size | None

    def digest(self) -> str:
        """Hash of what decides outputs: manifest and files."""
        return sha256(self.path.read_bytes()).hexdigest()[:32]

    def check_size(self, size: Size) -> None:
        """Hold LR frames to be of a size that the files take.

        Raises:
            CheckpointError: they are not; says which is, and how other files are made.
        """
        height, width = size
        if self.size is not None and size != self.size:
            raise CheckpointError(
                f"{self.path}: exported for LR frames of {self.size[1]}x{self.size[0]}, these are "
                f"{width}x{height}; rtsr export ... --size {width}x{height}, or without --size "
                "for any"
            )
        multiple = max(file.multiple for file in self.files)
        if self.size is None and (height % multiple or width % multiple):
            raise CheckpointError(
                f"{self.path}: takes LR frames whose sides are multiples of {multiple}, these are "
                f"{width}x{height}; rtsr export ... --size {width}x{height} makes files for them"
            )


def sum_manifest(facts: Mapping[str, Any]) -> str:
    """SHA-256 of all that a manifest says but of that itself."""
    said = {name: value for name, value in facts.items() if name != CHECKSUM}
    return sha256(json.dumps(said, sort_keys=True).encode()).hexdigest()


def find_manifest(path: Path) -> Path:
    """Return a folder's manifest, or the path itself."""
    return path / MANIFEST if path.is_dir() else path


def read_manifest(path: Path) -> Manifest:
    """Read the manifest of a folder, or one named itself, and hold its files to be those.

    Raises:
        CheckpointError: it is not there, damaged, or something else; or a file is not the one that
            was written with it.
    """
    place = find_manifest(path)
    try:
        facts = parse_json(read_text(place))
    except DocumentError as error:
        raise CheckpointError(f"{place}: {error}; rtsr export writes one{_say_extra()}") from error
    if isinstance(facts, dict) and facts.get("format") in OLDER:
        raise CheckpointError(
            f"{place}: of an older rtsr, which wrote no checksum of what it says; export again"
        )
    if not isinstance(facts, dict) or facts.get("format") != FORMAT:
        raise CheckpointError(f"{place}: this is no manifest of rtsr export")
    if facts.get(CHECKSUM) != sum_manifest(facts):
        raise CheckpointError(
            f"{place}: damaged or changed: what it says is not what was written (checksum); "
            "export again"
        )
    _check_facts(place, facts, FACTS)
    size = facts.get("size")
    if size is not None and not _is_size(size):
        raise CheckpointError(f"{place}: what it says of itself is damaged (size)")
    return Manifest(
        path=place,
        system=facts["system"],
        scale=facts["scale"],
        config=facts["config"],
        files=tuple(_read_file(place, graph) for graph in facts["graphs"]),
        values=facts["values"],
        about=facts["weights"].get("about", {}),
        size=None if size is None else (size[1], size[0]),
    )


def _say_extra() -> str:
    """How the extra gets there that both writing and running need; empty where it is."""
    there = importlib.util.find_spec("onnxruntime") is not None
    return "" if there else ", with the extra that is not installed: pip install 'rtsr[export]'"


def _is_size(value: object) -> bool:
    return isinstance(value, list) and len(value) == 2 and all(type(side) is int for side in value)


def _check_facts(place: Path, facts: Any, kinds: Mapping[str, type]) -> None:
    wrong = [name for name, kind in kinds.items() if type(facts.get(name)) is not kind]
    if wrong:
        raise CheckpointError(f"{place}: what it says of itself is damaged ({', '.join(wrong)})")


def _read_file(place: Path, graph: Any) -> ExportedFile:
    if not isinstance(graph, dict):
        raise CheckpointError(f"{place}: what it says of itself is damaged (graphs)")
    _check_facts(place, graph, GRAPH_FACTS)
    # a manifest leads to no file outside of its folder
    path = place.parent / Path(graph["file"]).name
    try:
        found = sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise CheckpointError(f"{path}: cannot be read ({error.strerror}); export again") from error
    if found != graph["sha256"]:
        raise CheckpointError(f"{path}: not the file that {place} was written with; export again")
    return ExportedFile(
        method=graph["method"],
        path=path,
        sha256=found,
        multiple=1 if graph.get("padding") else graph["multiple"],
    )
