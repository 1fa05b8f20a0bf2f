"""What an inspection says while it goes on."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rtsr_cli.core.inspect.readiness import Severity
from rtsr_cli.core.inspect.shot_inspection import ShotInspection


@dataclass(frozen=True, kw_only=True)
class FolderRefused:
    """A folder in which not even shots can be found; the call then raises.

    Attributes:
        inspection: what is known all the same.
        message: what is wrong, as it is raised.
    """

    inspection: ShotInspection
    message: str


@dataclass(frozen=True, kw_only=True)
class ShotsListed:
    """The shots are known.

    Attributes:
        count: how many there are.
    """

    count: int


@dataclass(frozen=True, kw_only=True)
class ShotInspected:
    """A shot has been looked at.

    Attributes:
        inspection: everything about it.
    """

    inspection: ShotInspection


@dataclass(frozen=True, kw_only=True)
class CaptureWritten:
    """A shot's capture.toml is written.

    Attributes:
        path: of the file.
        kept: file that the former one is kept as, None where there was none.
    """

    path: Path
    kept: Path | None


@dataclass(frozen=True, kw_only=True)
class CaptureBlocked:
    """A shot's capture.toml could not be written, which keeps no report back.

    Attributes:
        shot: name of the shot.
        message: what is in the way, and the remedy.
    """

    shot: str
    message: str


@dataclass(frozen=True, kw_only=True)
class InspectionDone:
    """The summary.

    Attributes:
        gravity: the worst that a command with default options does about any of the shots.
    """

    gravity: Severity


InspectEvent = (
    FolderRefused | ShotsListed | ShotInspected | CaptureWritten | CaptureBlocked | InspectionDone
)
