"""Files that are whole or not there: written beside the target, brought to the disk, renamed.

A temporary file has a name that nobody can guess and that fits wherever the target's does; it is
made anew, so that no link that lies in wait is followed.
"""

from __future__ import annotations

import errno
import os
import platform
import re
import secrets
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import cache
from pathlib import Path

from rtsr_cli.core.errors import OutputBlockedError, OutputError
from rtsr_cli.core.files.folders import describe_obstacle
from rtsr_cli.core.visible_text import make_visible

TEMPORARY_SUFFIX = ".rtsr-part"
"""Ends the name of a file that is still being written; never a finished one."""

WORD_ENDS = re.compile(r"[\s'\",]")
"""What stands beside names in a text."""

NAME_BYTES, HOST_CHARACTERS, RANDOM_BYTES = 32, 24, 6
"""What a temporary name holds of the target's, of the machine's, and that nobody can guess."""

UNSYNCED = frozenset({errno.EINVAL, errno.ENOTSUP, errno.ENOSYS})
"""What file systems say that bring nothing to a disk on request."""

FULL = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EIO})
"""The disk takes no more; an I/O error is what network drives say for it."""

BLOCKING = FULL | {
    errno.EFBIG,
    errno.EROFS,
    errno.EACCES,
    errno.EPERM,
    errno.ENOTDIR,
    errno.ESTALE,
}
"""What hits every file of a folder, not only the one that was being written."""

REMEDIES = {
    **dict.fromkeys(FULL, "free some space, or choose another output folder"),
    errno.EFBIG: "raise the limit on sizes of files (ulimit -f), or choose another output folder",
}
"""What helps, by error number."""

ABANDONED_S = 24 * 3600.0
"""A part that nobody has touched for so long belongs to a run that died, whoever's it was."""


def name_temporary(path: Path) -> Path:
    """`.<random>-<name>.<host>-<process>.rtsr-part` beside the target: its writer can be told."""
    start = os.fsencode(path.name)[:NAME_BYTES].decode(errors="ignore")
    unguessed = secrets.token_hex(RANDOM_BYTES)
    return path.with_name(f".{unguessed}-{start}.{_name_writer()}{TEMPORARY_SUFFIX}")


def _name_writer() -> str:
    return f"{_name_host()}-{os.getpid()}"


def _name_host() -> str:
    """This machine's name up to the first dot, as the dots part a temporary name."""
    return platform.node().partition(".")[0][:HOST_CHARACTERS] or "host"


def write_atomically(path: Path, write: Callable[[Path], None]) -> None:
    """Call `write(temporary path)`, bring it to the disk, rename; on failure keep what was there.

    The file gets the permissions of any new file, also from writers that would keep it private.
    What killed runs left half written in the folder is removed when it is first written to.

    Raises:
        OutputBlockedError: the disk is full, or the folder takes no files; names the target.
        OutputError: this file cannot be written; names it.
    """
    part = name_temporary(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _sweep_once(path.parent)
        part.touch(exist_ok=False)
        mode = part.stat().st_mode
        write(part)
        if part.stat().st_mode != mode:
            part.chmod(mode)
        _bring_to_disk(part)
        part.replace(path)
        _bring_name_to_disk(path.parent)
    except (OSError, RuntimeError, ValueError, TypeError) as error:
        raise _make_refusal(path, error) from error
    finally:
        # after a rename there is none; a thread that is interrupted leaves none either
        with suppress(OSError):
            part.unlink(missing_ok=True)


def _bring_to_disk(path: Path) -> None:
    """Wait until the content of a file would survive a crash of the machine."""
    number = os.open(path, os.O_RDWR)
    try:
        os.fsync(number)
    except OSError as error:
        if error.errno not in UNSYNCED:
            raise
    finally:
        os.close(number)


def _bring_name_to_disk(folder: Path) -> None:
    """Let a folder's list of names reach the disk, where the platform allows it."""
    with suppress(OSError):
        number = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(number)
        finally:
            os.close(number)


def write_text_atomically(path: Path, text: str) -> None:
    """Write a text as UTF-8, whole or not at all.

    Raises:
        OutputError: it cannot be written; names the file. Or a name in it is no text, as names of
            files that are not UTF-8 are none; names that.
    """
    try:
        content = text.encode()
    except UnicodeEncodeError as error:
        around = WORD_ENDS.split(text[: error.start])[-1] + WORD_ENDS.split(text[error.start :])[0]
        raise OutputError(
            f"{path}: is not written: it would have to name '{make_visible(around)}', which is not "
            "UTF-8, and no text holds such names; rename that"
        ) from error

    def write(part: Path) -> None:
        part.write_bytes(content)

    write_atomically(path, write)


def _make_refusal(path: Path, error: Exception) -> OutputError:
    code = error.errno if isinstance(error, OSError) else None
    why = os.strerror(code) if code is not None else str(error)
    remedy = REMEDIES.get(code or 0, "check permissions and free space")
    kind = OutputBlockedError if code in BLOCKING else OutputError
    return kind(f"{path}: cannot be written ({why}); {remedy}")


MOST_NAME_BYTES = 255
"""Of a name, where the file system does not say."""


def check_names(paths: Iterable[Path]) -> None:
    """Raise before anything is computed if the name of an output is longer than names can be.

    Raises:
        OutputError: names the longest.
    """
    longest = max(paths, key=lambda path: len(os.fsencode(path.name)), default=None)
    if longest is None:
        return
    there = next((folder for folder in longest.parents if folder.is_dir()), longest.parent)
    try:
        most = os.pathconf(there, "PC_NAME_MAX")
    except (AttributeError, OSError, ValueError):
        most = MOST_NAME_BYTES
    size = len(os.fsencode(longest.name))
    if size > most:
        raise OutputError(
            f"{longest}: the name of this output is {size} bytes long, and no name can have more "
            f"than {most}; give the frames shorter names"
        )


def check_writable(folder: Path) -> None:
    """Raise if a folder cannot be made or written to, before anything is computed.

    What killed runs left half written in it is removed.

    Raises:
        OutputError: names the folder.
    """
    obstacle = describe_obstacle(folder)
    if obstacle:
        raise OutputError(
            f"{folder}: cannot write here: {obstacle}; choose another output folder, or move that "
            "away"
        )
    probe = name_temporary(folder / "probe")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe.touch(exist_ok=False)
        probe.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(
            f"{folder}: cannot write here ({error.strerror}); check permissions, or choose "
            "another output folder"
        ) from error
    remove_leftovers(folder)


@cache
def _sweep_once(folder: Path) -> None:
    """Delete what killed runs left in a folder, when this process first writes to it."""
    remove_leftovers(folder)


def remove_leftovers(folder: Path) -> None:
    """Delete what killed runs left half written; parts that others are writing stay."""
    if not folder.is_dir():
        return
    for part in folder.glob(f".*{TEMPORARY_SUFFIX}"):
        with suppress(OSError):
            if _is_abandoned(part):
                part.unlink(missing_ok=True)


def _is_abandoned(part: Path) -> bool:
    writer = part.name.removesuffix(TEMPORARY_SUFFIX).rpartition(".")[2]
    host, _, process = writer.rpartition("-")
    here = host == _name_host() and process.isdigit()
    if here and not _is_alive(int(process)):
        return True
    # of another machine's; or the number of the process is another's by now
    return time.time() - part.lstat().st_mtime > ABANDONED_S


def _is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
