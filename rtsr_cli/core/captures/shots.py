"""Finding shots in a folder tree: which files form which sequence, before any is opened."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from pathlib import Path

from rtsr_cli.core.captures.file_sequences import FileSequence, group_sequences, list_sequences
from rtsr_cli.core.captures.folder_visits import FolderVisits
from rtsr_cli.core.captures.layouts import FolderTree, Layout
from rtsr_cli.core.errors import FrameFolderError, OutputError
from rtsr_cli.core.files.folders import (
    find_real_path,
    is_file,
    is_folder,
    list_content,
    list_names,
)

LR_FOLDER, HR_FOLDER = "lr", "hr"
"""Names of a shot's two resolutions."""

REFERENCE_FOLDER = "reference"
"""Beside `lr` and `hr`: radiance at the target size, as `rtsr synth --scale` writes it."""

TARGET_FOLDERS = frozenset({HR_FOLDER, REFERENCE_FOLDER})
"""Folders of a shot that hold frames of the target size, which no LR jitter moves."""

SHOT_PARTS = TARGET_FOLDERS | {LR_FOLDER}
"""Folders of one shot, which declares what they hold."""

SCALE = re.compile(r"\d+(_\d+)?")
"""A ratio of resolutions as folders write it: 2, 1_5."""

USUAL_SCALE = "2"
"""Taken of several resolutions where nobody names one."""


OTHER_RATE = re.compile(r"output_[1-4]x[1-4]")
"""Folders beside frames that hold the same ones at another shading rate: no shots of their own."""


@dataclass(frozen=True, kw_only=True)
class FrameSet:
    """The file sequences that together hold the frames of one resolution."""

    root: Path
    streams: Mapping[str, FileSequence]

    @property
    def numbers(self) -> tuple[int, ...]:
        """Every frame number that any stream has."""
        return tuple(sorted({n for stream in self.streams.values() for n in stream.files}))

    def without(self, numbers: Collection[int]) -> FrameSet:
        """Return the same sequences without the files of some frames."""
        kept = {
            key: replace(s, files={n: path for n, path in s.files.items() if n not in numbers})
            for key, s in self.streams.items()
        }
        return replace(self, streams={key: s for key, s in kept.items() if s.files})


@dataclass(frozen=True, kw_only=True)
class Shot:
    """One sequence of a tree: `name` is its path relative to IN ('.' for IN itself).

    `layout` and `side_car` (a file of cameras) are known where a data set's folders tell them;
    `remarks` say what the search left out.
    """

    name: str
    root: Path
    frames: FrameSet
    hr: FrameSet | None = None
    layout: str | None = None
    side_car: Path | None = None
    remarks: tuple[str, ...] = ()


def collect_frame_set(folder: Path, buffer_folders: Iterable[str] = ()) -> FrameSet | None:
    """Collect the frames of one resolution below a folder; None if there are none.

    Args:
        folder: where the frames are.
        buffer_folders: patterns of subfolders that each hold one buffer; if more than one such
            has frames, they belong together, and to those of the folder itself.
    """
    content, patterns = list_content(folder), tuple(buffer_folders)
    claimed = [
        list_sequences(folder / name, f"{name}/")
        for name in content.folders
        if any(fnmatchcase(name, pattern) for pattern in patterns)
    ]
    streams = group_sequences(content)
    if sum(map(bool, claimed)) > 1:
        streams |= {key: stream for part in claimed for key, stream in part.items()}
    return FrameSet(root=folder, streams=streams) if streams else None


def _declare_nothing(_: Path) -> Iterable[str]:
    return ()


@dataclass(frozen=True, kw_only=True)
class _Search:
    """What the walk through a tree looks for; see `find_shots`."""

    root: Path
    buffer_folders: tuple[str, ...]
    trees: tuple[Layout, ...]
    scale: int | None
    declared: Callable[[Path], Iterable[str]]
    visits: FolderVisits
    entered: list[Path] = field(default_factory=list)


def find_shots(
    root: Path,
    *,
    buffer_folders: Iterable[str] = (),
    trees: Iterable[Layout] = (),
    scale: int | None = None,
    declared: Callable[[Path], Iterable[str]] = _declare_nothing,
    output: Path | None = None,
) -> list[Shot]:
    """List the shots of a tree, sorted by path.

    A folder with `lr/` is a shot with two resolutions; a folder with frames is a shot; a data
    set with folders of its own is as many as it holds.

    Args:
        root: IN.
        buffer_folders: patterns of folders that each hold one buffer.
        trees: layouts of data sets with folders of their own.
        scale: which LR of such a data set is wanted.
        declared: further buffer folders, which the capture.toml of a folder declares.
        output: where frames will be written.

    Raises:
        FrameFolderError: the folder does not exist, is a file, or holds no numbered EXR frame.
        OutputError: what is written would be taken for frames of IN.
    """
    if is_file(root):
        raise FrameFolderError(f"{root}: is a file; name the folder that holds the frames")
    if not is_folder(root):
        raise FrameFolderError(f"{root}: no such folder")
    list_names(root)
    search = _Search(
        root=root,
        buffer_folders=tuple(buffer_folders),
        trees=tuple(trees),
        scale=scale,
        declared=declared,
        visits=FolderVisits(),
    )
    shots = _walk_tree(root, search)
    if output is not None:
        _check_output(output, shots, search)
    if not shots:
        raise FrameFolderError(
            f"{root}: no numbered EXR frames here or below (expected names like "
            f"'frame.0001.exr', 'lr/0001.exr'{_describe_others(root)})"
        )
    return [replace(shots[0], remarks=search.visits.remarks), *shots[1:]]


def _walk_tree(root: Path, search: _Search) -> list[Shot]:
    """Shots of a folder and those below, sorted by path; links are followed at the end."""
    shots = list(_walk_folder(root, search))
    for link in search.visits.next_links():
        shots += _walk_folder(link, search)
    return sorted(shots, key=lambda shot: Path(shot.name))


def _check_output(output: Path, shots: Iterable[Shot], search: _Search) -> None:
    """Raise where outputs would lie among the frames, or where a search of IN would find them."""
    if find_real_path(output) == find_real_path(search.root):
        raise OutputError(f"{output}: OUT is IN itself; choose another output folder")
    for shot in shots:
        for frames in (shot.frames, shot.hr):
            refuse_among(output / shot.name, frames)
    above = next(p for p in find_real_path(output).parents if is_folder(p))
    hidden = output.name.startswith(".")
    if not hidden and above in {find_real_path(folder) for folder in search.entered}:
        raise OutputError(
            f"{output}: lies inside IN, where its frames would be taken for inputs; choose an "
            f"output folder outside of {search.root}"
        )


def refuse_among(output: Path, frames: FrameSet | None) -> None:
    """Raise where a folder of outputs holds the frames of a set.

    Raises:
        OutputError: names the folder.
    """
    folders = set() if frames is None else {s.folder for s in frames.streams.values()}
    if find_real_path(output) in {find_real_path(folder) for folder in folders}:
        raise OutputError(
            f"{output}: holds frames that are read; choose another output folder than theirs"
        )


def _walk_folder(folder: Path, search: _Search) -> Iterable[Shot]:
    subfolders = search.visits.enter(folder)
    if subfolders is None:
        return
    name = folder.relative_to(search.root).as_posix()
    names = (*search.buffer_folders, *search.declared(folder))
    both = _find_lr_and_hr(folder, name, names, search)
    held = [both] if both else _find_data_set(folder, search)
    yield from held
    if held:
        return
    here = collect_frame_set(folder, names)
    if here is not None:
        yield Shot(name=name, root=folder, frames=here)
        if any("/" in key for key in here.streams):
            return
    search.entered.append(folder)
    beside = OTHER_RATE.fullmatch if here is not None else (lambda _: None)
    for child in search.visits.put_off_links(f for f in subfolders if not beside(f.name)):
        yield from _walk_folder(child, search)


def _find_lr_and_hr(
    folder: Path, name: str, names: tuple[str, ...], search: _Search
) -> Shot | None:
    """Return the shot of a folder with `lr/`, and `hr/` beside it."""
    lr, hr = (
        collect_frame_set(folder / sub, names) if is_folder(folder / sub) else None
        for sub in (LR_FOLDER, HR_FOLDER)
    )
    if lr is not None:
        return Shot(name=name, root=folder, frames=lr, hr=hr)
    if hr is not None and is_folder(folder / LR_FOLDER):
        _check_not_empty(folder / LR_FOLDER, search)
    return None


PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".hdr", ".npy", ".pfm")
"""Suffixes of pictures in other formats."""


def _describe_others(root: Path) -> str:
    """Say what a folder holds in place of frames; nothing where it is nothing alike."""
    names = list_names(root)
    plain = [name for name in names if name.lower().endswith(".exr")]
    others = sorted({s for name in names for s in PICTURES if name.lower().endswith(s)})
    if plain:
        return f"; '{plain[0]}' has no frame number: rename it, say to 'frame.0001.exr'"
    return f"; the {' and '.join(others)} files here are not read: write EXR" if others else ""


def _find_data_set(folder: Path, search: _Search) -> list[Shot]:
    """Shots of the first data set whose root this folder is."""
    shots = (_list_tree_shots(folder, layout, search) for layout in search.trees)
    return next((shots for shots in shots if shots), [])


def _check_not_empty(lr: Path, search: _Search) -> None:
    """Raise where HR frames have no LR frames beside them, though there is a folder for such."""
    if not any(_walk_folder(lr, replace(search, visits=FolderVisits(), entered=[]))):
        raise FrameFolderError(
            f"{lr}: no numbered EXR frames here, though '{HR_FOLDER}' beside it has some; render "
            "the LR frames, or make them with --simulate-lr from the 'hr' folder"
        )


def _list_tree_shots(folder: Path, layout: Layout, search: _Search) -> list[Shot]:
    """Shots of a data set whose root is this folder; none if it is no such root."""
    tree = layout.tree
    if tree is None:
        return []
    scale = _choose_scale(folder, tree, layout.files, search.scale)
    lr = (
        {}
        if scale is None
        else _collect_sets(folder, tree.lr.replace("{scale}", scale), layout.known_files)
    )
    # names of LR's buffers are common ones: without LR, only HR's own tell the data set
    hr = _collect_sets(folder, tree.hr, layout.known_files if lr else tree.hr_buffers)
    shots = []
    for shot in sorted(lr or hr):
        side_car = None if tree.side_car is None else folder / tree.side_car.format(shot=shot)
        shots.append(
            Shot(
                name=(folder.relative_to(search.root) / shot).as_posix(),
                root=folder,
                frames=lr.get(shot) or hr[shot],
                hr=hr.get(shot) if lr else None,
                layout=layout.name,
                side_car=side_car if side_car is not None and is_file(side_car) else None,
            )
        )
    return shots


def _collect_sets(folder: Path, template: str, buffers: tuple[str, ...]) -> dict[str, FrameSet]:
    """Frame sets of one resolution of a data set, by shot."""
    streams: dict[str, dict[str, FileSequence]] = {}
    above = template.partition("{shot}")[0]
    for buffer in buffers:
        held = folder / above.format(buffer=buffer)
        for shot in list_content(held).folders if is_folder(held) else ():
            path = folder / template.format(buffer=buffer, shot=shot)
            if is_folder(path):
                sequences = list_sequences(path, prefix=f"{buffer}/")
                streams.setdefault(shot, {}).update(sequences)
    root = folder / template.partition("{buffer}")[0].partition("{shot}")[0]
    return {shot: FrameSet(root=root, streams=s) for shot, s in streams.items() if s}


def _choose_scale(
    folder: Path, tree: FolderTree, buffers: tuple[str, ...], wanted: int | None
) -> str | None:
    """Which of the LR resolutions of a data set to read, as its folder writes it; None if none.

    Raises:
        FrameFolderError: there are several and none is the wanted or usual one, or only such
            as are no whole multiple.
    """
    first = tree.lr.partition("/")[0]
    before, _, after = first.partition("{scale}")
    names = (n for n in list_content(folder).folders if n.startswith(before))
    scales = (n.removeprefix(before).removesuffix(after) for n in names if n.endswith(after))
    there = sorted(s for s in scales if SCALE.fullmatch(s) and _is_lr(folder, tree, buffers, s))
    if not there:
        return None
    whole = [s for s in there if "_" not in s]
    if wanted is not None and str(wanted) in whole:
        return str(wanted)
    if wanted is None and len(whole) == 1:
        return whole[0]
    if wanted is None and USUAL_SCALE in whole:
        return USUAL_SCALE
    listed = ", ".join(f"'{first.format(scale=s)}'" for s in there)
    remedy = f"choose one with --scale ({', '.join(whole)})" if whole else "render another ratio"
    raise FrameFolderError(
        f"{folder}: of the LR folders {listed}, none has the scale "
        f"{'that is wanted' if wanted is None else wanted}; only whole scales can be "
        f"reconstructed: {remedy}"
    )


def _is_lr(folder: Path, tree: FolderTree, buffers: tuple[str, ...], scale: str) -> bool:
    return bool(_collect_sets(folder, tree.lr.replace("{scale}", scale), buffers))
