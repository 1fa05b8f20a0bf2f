"""Jobs as files: an engine each, and which of them rtsr wrote."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from rtsr_cli import __version__
from rtsr_cli.core.choices import FarmEngine
from rtsr_cli.core.errors import OutputError
from rtsr_cli.core.farms.commands import FarmJob
from rtsr_cli.core.farms.openjd import write_openjd
from rtsr_cli.core.farms.slurm import write_slurm
from rtsr_cli.core.files.atomic_write import check_writable, write_text_atomically
from rtsr_cli.core.files.folders import is_folder
from rtsr_cli.core.files.ownership import list_foreign, refuse_foreign
from rtsr_cli.core.marks import MARK

WRITERS: Mapping[FarmEngine, Callable[[FarmJob, str], str]] = {
    FarmEngine.OPENJD: write_openjd,
    FarmEngine.SLURM: write_slurm,
}
"""What writes a job for an engine: (job, what it says that it is) -> text."""

HEAD_BYTES = 4096
"""The mark stands near the beginning."""

MOST_LETTERS = 1500
"""Of the command in a job's description, which an engine bounds."""


def encode_job(job: FarmJob, engine: FarmEngine, made_by: str) -> str:
    """Write a job in an engine's words.

    Args:
        job: to write.
        engine: that runs it.
        made_by: the command that makes it, on one line.

    Raises:
        RequestError: the engine has no way to say it.
    """
    return WRITERS[engine](job, f"{MARK} {__version__}; made by: {made_by[:MOST_LETTERS]}")


def write_job(path: Path, text: str, *, overwrite: bool) -> None:
    """Write the file of a job; the same job is written again without being asked.

    Raises:
        OutputError: something else is there, another job too, or it cannot be written.
    """
    if is_folder(path):
        raise OutputError(f"{path}: a folder; name a file, such as {path / 'job.json'}")
    if not overwrite:
        refuse_foreign(list_foreign([path], _is_job), "rtsr farm")
        _refuse_other_job(path, text)
    check_writable(path.parent)
    write_text_atomically(path, text)


def _refuse_other_job(path: Path, text: str) -> None:
    """Refuse to replace a job that does something else.

    Raises:
        OutputError: the file holds one.
    """
    if path.is_file() and path.read_text(encoding="utf-8", errors="replace") != text:
        raise OutputError(
            f"{path}: a job of another command, or of another version of rtsr; give --overwrite to "
            "replace it, or another --output"
        )


def _is_job(path: Path) -> bool:
    """Tell whether rtsr wrote a file of a job: formats have no room for marks but in words."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return f"{MARK} ".encode() in file.read(HEAD_BYTES)
