"""Finding shots in a folder tree: which files form which sequence, before any is opened."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import fileseq

from rtsr_cli.core.errors import FrameFolderError

LR_FOLDER, HR_FOLDER = "lr", "hr"
"""Names of a shot's two resolutions."""

FRAME_SUFFIX = ".exr"


@dataclass(frozen=True, kw_only=True)
class Stream:
    """One numbered file sequence: what one wildcard would name."""

    key: str
    base: str
    files: Mapping[int, Path]


@dataclass(frozen=True, kw_only=True)
class FrameSet:
    """The file sequences that together hold the frames of one resolution."""

    root: Path
    streams: Mapping[str, Stream]

    @property
    def numbers(self) -> tuple[int, ...]:
        """Every frame number that any stream has."""
        return tuple(sorted({n for stream in self.streams.values() for n in stream.files}))


@dataclass(frozen=True, kw_only=True)
class Shot:
    """One sequence of a tree: `name` is its path relative to IN ('.' for IN itself)."""

    name: str
    root: Path
    frames: FrameSet
    hr: FrameSet | None = None


def _streams(folder: Path, prefix: str = "") -> dict[str, Stream]:
    """Return the numbered EXR sequences directly in a folder."""
    found: dict[str, dict[int, Path]] = {}
    bases: dict[str, str] = {}
    for sequence in fileseq.findSequencesOnDisk(str(folder)):
        frames = sequence.frameSet()
        if frames is None or sequence.extension().lower() != FRAME_SUFFIX:
            continue
        base = sequence.basename().rstrip("._- ")
        key = f"{prefix}{base}"
        for index, number in enumerate(frames):
            path = Path(str(sequence[index]))
            other = found.setdefault(key, {}).setdefault(int(number), path)
            if other != path:
                raise FrameFolderError(
                    f"{folder}: frame {number} is there twice ({other.name} and {path.name}); "
                    "remove one of them"
                )
        bases[key] = base
    return {
        key: Stream(key=key, base=bases[key], files=_in_order(files, bases[key]))
        for key, files in found.items()
    }


def _in_order(files: Mapping[int, Path], base: str) -> dict[int, Path]:
    """Sort by number; a dash that follows the name in every file separates, it is no sign."""
    after = [path.name[len(base) : len(base) + 2] for path in files.values()]
    separated = base and all(text[:1] == "-" and text[1:].isdigit() for text in after)
    return dict(sorted((-n if separated else n, path) for n, path in files.items()))


def frame_set(folder: Path, buffer_folders: Iterable[str] = ()) -> FrameSet | None:
    """Collect the frames of one resolution below a folder; None if there are none.

    Args:
        folder: where the frames are.
        buffer_folders: names of subfolders that each hold one buffer; if more than one of them
            is there, they are the frames.
    """
    claimed = [folder / name for name in buffer_folders if (folder / name).is_dir()]
    if len(claimed) > 1:
        parts = [_streams(sub, prefix=f"{sub.name}/") for sub in claimed]
        streams = {key: stream for part in parts for key, stream in part.items()}
    else:
        streams = _streams(folder)
    return FrameSet(root=folder, streams=streams) if streams else None


def find_shots(
    root: Path, *, buffer_folders: Iterable[str] = (), output: Path | None = None
) -> list[Shot]:
    """List the shots of a tree, sorted by path; `output` below it is not searched.

    A folder with `lr/` is a shot with two resolutions; a folder with frames is a shot.

    Raises:
        FrameFolderError: the folder does not exist, is a file, or holds no numbered EXR frame.
    """
    if root.is_file():
        raise FrameFolderError(f"{root}: is a file; name the folder that holds the frames")
    if not root.is_dir():
        raise FrameFolderError(f"{root}: no such folder")
    names = tuple(buffer_folders)
    outputs = None if output is None else output.resolve()
    shots = [s for s in _walk(root, root, names) if not _below(s.root, outputs, root)]
    if not shots:
        raise FrameFolderError(
            f"{root}: no numbered EXR frames here or below (expected names like "
            "'frame.0001.exr', 'lr/0001.exr')"
        )
    return shots


def _below(folder: Path, output: Path | None, root: Path) -> bool:
    """Tell whether a shot lies in the folder of outputs, itself inside the tree."""
    if output is None or output == root.resolve() or not output.is_relative_to(root.resolve()):
        return False
    return folder.resolve().is_relative_to(output)


def _walk(root: Path, folder: Path, buffer_folders: tuple[str, ...]) -> Iterable[Shot]:
    name = folder.relative_to(root).as_posix()
    lr = frame_set(folder / LR_FOLDER, buffer_folders) if (folder / LR_FOLDER).is_dir() else None
    if lr is not None:
        has_hr = (folder / HR_FOLDER).is_dir()
        hr = frame_set(folder / HR_FOLDER, buffer_folders) if has_hr else None
        yield Shot(name=name, root=folder, frames=lr, hr=hr)
        return
    here = frame_set(folder, buffer_folders)
    if here is not None:
        yield Shot(name=name, root=folder, frames=here)
        if any("/" in key for key in here.streams):
            return
    for child in sorted(folder.iterdir()):
        if child.is_dir() and not child.name.startswith("."):
            yield from _walk(root, child, buffer_folders)
