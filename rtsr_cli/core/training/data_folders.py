"""From the folders and packs of DATA to clips, sequences kept whole on either side of the split."""

from __future__ import annotations

import json
from collections.abc import Generator, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import cast

from rtsr_cli import __version__
from rtsr_cli.core.captures.declarations import DeclarationFiles
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.captures.shared_warnings import list_warnings
from rtsr_cli.core.captures.shots import REFERENCE_FOLDER, FrameSet, Shot, collect_frame_set
from rtsr_cli.core.choices import NonfinitePolicy
from rtsr_cli.core.documents import DocumentError, read_json
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.atomic_write import write_text_atomically
from rtsr_cli.core.files.folders import is_file, is_folder
from rtsr_cli.core.files.ownership import list_foreign, refuse_foreign
from rtsr_cli.core.files.provenance import digest_config, digest_values
from rtsr_cli.core.files.tensor_file import is_whole_tensor_file
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.camera_needs import say_frames
from rtsr_cli.core.marks import MARKED
from rtsr_cli.core.pairs.auxiliary_radiance import AuxiliaryRadiance, find_auxiliary
from rtsr_cli.core.pairs.lacking_frames import leave_out_lacking, list_needed_inputs
from rtsr_cli.core.pairs.opening import (
    OpenedShot,
    ReadOptions,
    find_shots_of,
    open_declarations,
    open_pair,
    open_set,
    open_shot,
)
from rtsr_cli.core.pairs.simulation import Simulation
from rtsr_cli.core.pairs.sources import PairInputs, PairSource
from rtsr_cli.core.training.clip_recording import (
    RECORDING,
    CapturedShot,
    RecordedInputs,
    record_clips_of,
)
from rtsr_cli.core.training.clips import DOUBTS, Clip, read_clips
from rtsr_cli.core.training.config import DataConfig

MANIFEST = "manifest.json"
"""A data set's list of sequences with their split, beside its scenes."""

HELD_OUT = 8
"""One of so many shots is judged on where nothing says which."""

MIN_SHOTS = 3
"""Of fewer shots none is held out."""


@dataclass(frozen=True, kw_only=True)
class ClipSources:
    """How clips are gathered.

    Attributes:
        wanted: what is recorded.
        cache: folder of recordings.
        options: how frames are read.
        policy: for NaN and Inf.
        data: which shots.
        samples_per_pixel: K of captures, whose sizes have to be multiples of K S.
        overwrite: replace files of others in the cache.
    """

    wanted: RecordedInputs
    cache: Path
    options: ReadOptions
    policy: NonfinitePolicy
    data: DataConfig
    samples_per_pixel: int = 1
    overwrite: bool = False


def gather_clips(folders: Sequence[Path], how: ClipSources) -> Generator[str, None, list[Clip]]:
    """Record (or find recorded) every shot of every folder; one group a folder.

    Yields lines for a person; returns the clips.

    Raises:
        RtsrError: a folder, file or declaration is wrong, or patterns match nothing.
    """
    clips: list[Clip] = []
    for shot in choose_shots(folders, how):
        paths = yield from record_clips(shot, how)
        for path in paths:
            held, about = read_clips(path)
            clips += [_name_clip(clip, shot) for clip in held]
            said = cast(Sequence[str], about.get(DOUBTS, ()))
            yield from (f"Warning: {shot.name}, frames {about['frames']}: {t}" for t in said)
    return clips


def _name_clip(clip: Clip, shot: ChosenShot) -> Clip:
    """Say which shot of which folder a clip is of."""
    facts = replace(
        clip.facts,
        name=shot.name,
        group=shot.group,
        validation=shot.validation,
        licence=shot.files.resolve_for(shot.shot).capture.licence or "",
    )
    return replace(clip, facts=facts)


@dataclass(frozen=True, kw_only=True)
class ChosenShot:
    """A shot that a run uses.

    Attributes:
        name: shown to users, and matched by patterns.
        shot: its files.
        folder: of DATA.
        group: number of the folder.
        validation: True if it is judged on.
        files: what is declared below the folder.
    """

    name: str
    shot: Shot
    folder: Path
    group: int
    validation: bool
    files: DeclarationFiles


def choose_shots(folders: Sequence[Path], how: ClipSources) -> list[ChosenShot]:
    """Say which shots are trained and judged on, in the order of the folders.

    Raises:
        RtsrError: a folder or declaration is wrong, or patterns match nothing.
    """
    chosen: list[ChosenShot] = []
    patterns = set(how.data.validation) | set(how.data.exclude)
    told = bool(how.data.validation) or any(read_manifest_split(folder) for folder in folders)
    for group, folder in enumerate(folders):
        files = open_declarations(folder, how.options)
        there = find_shots_of(folder, how.options, files=files)
        shots = {name_shot(folder, shot): shot for shot in there}
        split = split_shots(folder, list(shots), how.data, hold_out=not told)
        patterns -= {p for p in patterns if any(fnmatchcase(n, p) for n in shots)}
        chosen += [
            ChosenShot(
                name=name,
                shot=shot,
                folder=folder,
                group=group,
                validation=split[name] == VALIDATION,
                files=files,
            )
            for name, shot in shots.items()
            if split.get(name) in (TRAIN, VALIDATION)
        ]
    if patterns:
        raise FrameFolderError(
            f"[data] {', '.join(sorted(patterns))} matches no shot of "
            f"{', '.join(map(str, folders))}"
        )
    return chosen


def name_shot(folder: Path, shot: Shot) -> str:
    """Name of a shot; of a folder that is one shot, the folder's."""
    return folder.resolve().name if shot.name == "." else shot.name


TRAIN, VALIDATION = "train", "val"


def split_shots(
    folder: Path, names: Sequence[str], data: DataConfig, *, hold_out: bool
) -> dict[str, str]:
    """Shot -> `train`, `val` or another word, which leaves it out.

    By patterns where there are any; else by the folder's manifest, whose other shots are left out;
    else, with `hold_out`, every `HELD_OUT`th shot is for validation, from `MIN_SHOTS` on.

    Raises:
        FrameFolderError: the manifest cannot be read.
    """
    left = [n for n in names if not _match_patterns(n, data.exclude)]
    if data.validation:
        return {n: VALIDATION if _match_patterns(n, data.validation) else TRAIN for n in left}
    listed = read_manifest_split(folder)
    if listed:
        return {n: listed[n] for n in left if n in listed}
    enough = hold_out and len(left) >= MIN_SHOTS
    held = set(left[HELD_OUT // 2 :: HELD_OUT] or left[1:2]) if enough else set()
    return {n: VALIDATION if n in held else TRAIN for n in left}


def _match_patterns(name: str, patterns: Iterable[str]) -> bool:
    return any(fnmatchcase(name, pattern) for pattern in patterns)


def read_manifest_split(folder: Path) -> dict[str, str]:
    """`scene/sequence` -> split, by a manifest; empty if there is none.

    Raises:
        FrameFolderError: it is no manifest.
    """
    path = folder / MANIFEST
    if not is_file(path):
        return {}
    try:
        sequences = read_json(path)["sequences"]
        return {f"{s['scene']}/{s['sequence']}": str(s["split"]) for s in sequences}
    except (ValueError, KeyError, TypeError) as error:
        raise FrameFolderError(
            f"{path}: not a list of sequences with scene, sequence and split ({error!r}); mend it, "
            "or give data.validation"
        ) from error


def record_clips(chosen: ChosenShot, how: ClipSources) -> Generator[str, None, list[Path]]:
    """Files of clips of a shot; one that was recorded before is not even surveyed again.

    Yields lines for a person; returns the paths.

    Raises:
        RtsrError: a file or declaration is wrong.
    """
    shot = chosen.shot
    opened = open_shot(shot, chosen.folder, how.options, files=chosen.files)
    index = how.cache / f"{_hash_shot(opened, how)}.json"
    recorded = _read_index(index)
    if recorded is not None:
        yield from recorded.remarks
        return recorded.paths
    if not how.overwrite:
        refuse_foreign(list_foreign([index]), "rtsr train")
    real = shot.hr is not None and bool(shot.frames.streams) and shot.frames.root != shot.hr.root
    simulation = Simulation(scale=how.wanted.scale, samples_per_pixel=how.samples_per_pixel)
    hr, simulated = (shot.hr, None) if real else (None, simulation)
    source = open_whole(opened, how.wanted, hr=hr, simulation=simulated)
    captured = CapturedShot(
        source,
        _open_reference(opened, source) if real else None,
        () if real else _find_auxiliary(source, how),
    )
    if source.misfit:
        raise FrameFolderError(f"{source.misfit}, or leave the shot out (data.exclude)")
    remarks = _list_remarks(captured.readers)
    if source.misfit_doubt:
        remarks.append(f"Warning: {source.misfit_doubt}")
    yield from remarks
    if source.scale != how.wanted.scale:
        raise FrameFolderError(
            f"{shot.root}: HR is {source.scale} times the size of LR; training.scale is "
            f"{how.wanted.scale}; set that, or name a folder of frames of one size"
        )
    paths = yield from record_clips_of(
        captured, how.wanted, cache=how.cache, policy=how.policy, overwrite=how.overwrite
    )
    content = {**MARKED, "files": [path.name for path in paths], "remarks": remarks}
    write_text_atomically(index, json.dumps(content))
    return paths


def open_whole(
    opened: OpenedShot,
    wanted: RecordedInputs,
    *,
    hr: FrameSet | None,
    simulation: Simulation | None,
) -> PairSource:
    """Survey a shot, but for frames that lack what is recorded.

    Raises:
        RtsrError: a file or declaration is wrong.
    """
    inputs = PairInputs(lr=wanted.lr, hr=wanted.hr, derivation=wanted.derivation)

    def open_shots(needed: frozenset[Buffer]) -> list[tuple[str, PairSource]]:
        without = replace(opened, options=replace(opened.options, needed=needed))
        return [(opened.shot.name, open_pair(without, hr=hr, simulation=simulation))]

    ((_, source),) = leave_out_lacking(
        open_shots,
        opened.options.on_missing,
        lambda whole, without: list_needed_inputs(whole, without, inputs),
    )
    return source


def _list_remarks(readers: Sequence[FrameReader]) -> list[str]:
    """What contradicts, and what is unverified or left open, each said once."""
    warnings = (f"Warning: {text}" for text in list_warnings(readers))
    notes = (f"{reader.frames.root}: {text}" for reader in readers for text in reader.notes)
    return list(dict.fromkeys((*warnings, *notes)))


@dataclass(frozen=True, kw_only=True)
class _Recorded:
    """Clips of a shot that were recorded before, and what was said of its frames."""

    paths: list[Path]
    remarks: list[str]


def _read_index(index: Path) -> _Recorded | None:
    """What an index names beside it, None unless all of the files are there, and whole."""
    try:
        content = read_json(index)
    except DocumentError:
        return None
    known = content if isinstance(content, dict) else {}
    names, remarks = (_list_texts(known.get(key)) for key in ("files", "remarks"))
    if not names or remarks is None or any(Path(name).name != name for name in names):
        return None
    paths = [index.with_name(name) for name in names]
    whole = all(map(is_whole_tensor_file, paths))
    return _Recorded(paths=paths, remarks=remarks) if whole else None


def _list_texts(value: object) -> list[str] | None:
    """A list of texts, None if it is none."""
    if not isinstance(value, list):
        return None
    texts = [text for text in value if isinstance(text, str)]
    return texts if len(texts) == len(value) else None


def _open_reference(opened: OpenedShot, source: PairSource) -> FrameReader | None:
    """Radiance beside the HR frames, in `reference/`, where they hold none themselves.

    Raises:
        FrameFolderError: it is of another size, or lacks frames.
    """
    hr = source.readers[-1]
    beside = opened.shot.root / REFERENCE_FOLDER
    if Buffer.COLOR in hr.stored or not is_folder(beside):
        return None
    frames = collect_frame_set(beside, ())
    if frames is None:
        return None
    reader = open_set(frames, opened, jittered=False, vectors=False)
    lacking = sorted(set(source.reader.numbers) - set(reader.numbers))
    if reader.size != hr.size or lacking:
        what = f"lacks {say_frames(lacking)}" if lacking else "is of another size than HR"
        raise FrameFolderError(f"{beside}: {what}; render it with the HR frames")
    return reader


def _find_auxiliary(source: PairSource, how: ClipSources) -> tuple[AuxiliaryRadiance, ...]:
    """Further radiance that was captured."""
    return find_auxiliary(source, how.wanted.beside, source.reader.numbers, how.options, how.policy)


def _hash_shot(opened: OpenedShot, how: ClipSources) -> str:
    """Hash of names, sizes and times of a shot's files, and of everything declared about it."""
    shot = opened.shot
    folders = [shot.root / name for name in (REFERENCE_FOLDER, *how.wanted.beside)]
    apart = [collect_frame_set(beside, ()) for beside in folders if is_folder(beside)]
    sets = [frames for frames in (shot.frames, shot.hr, *apart) if frames is not None]
    # what is recorded does not depend on K, but whether it may be: that is checked for each
    samples = () if how.samples_per_pixel == 1 else (how.samples_per_pixel,)
    return digest_values(
        digest_config(
            RECORDING, __version__, asdict(how.wanted), how.policy.value, how.options, *samples
        ),
        str(opened.declarations),
        [_list_files(frames) for frames in sets],
    )


def _list_files(frames: FrameSet) -> list[tuple[str, int, int]]:
    paths = sorted({path for stream in frames.streams.values() for path in stream.files.values()})
    stats = [(path, path.stat()) for path in paths]
    return [(str(path.resolve()), stat.st_size, stat.st_mtime_ns) for path, stat in stats]
