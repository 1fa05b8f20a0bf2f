"""Options and parameter types that two or more commands take.

Validation is in the parameter types, so that the library sees good values only.
"""

from __future__ import annotations

import json
import logging
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import MISSING, fields
from enum import StrEnum
from pathlib import Path
from typing import Any, TypeVar

import click
from click.shell_completion import CompletionItem

from rtsr_cli.core.captures.layout_names import LAYOUT_NAMES, LAYOUT_SUFFIX
from rtsr_cli.core.choices import MissingPolicy, NonfinitePolicy, Runtime
from rtsr_cli.core.documents import shorten_value
from rtsr_cli.core.errors import RequestError, did_you_mean
from rtsr_cli.core.frames.selection import format_ranges
from rtsr_cli.core.requests import MOST_JOBS
from rtsr_cli.core.visible_text import make_all_visible

F = TypeVar("F", bound=Callable[..., Any])
E = TypeVar("E", bound=StrEnum)
R = TypeVar("R")

DOTS = re.compile(r"(?<=\d)\.\.(?=-?\d)")
"""Between the bounds of a range, as `format_ranges` writes them where one is negative."""

BOUNDS = re.compile(r"(?:^|,)(-?\d{1,27})-(-?\d{1,27})(?=$|[,x:y])")
"""First and last number of each range."""

PLAIN_RANGE = re.compile(r"(-?\d{1,27})(?:-(-?\d{1,27}))?")
"""A number, or the first and the last of a range."""

MOST_FRAMES = 10_000_000
"""Numbers that `--frames` names at most, each of which takes memory; what fileseq takes."""

JSON_CHOSEN = "rtsr.json"
"""Key of a context's `meta`: whether events go to stdout."""


class Frames(click.ParamType[frozenset[int]]):
    """Frame ranges: 1-100, 1-100x2, 1-3,5,7-20; -3..2 (or -3-2) where numbers are negative."""

    name = "RANGE"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> frozenset[int]:
        """Read numbers and plain ranges; others by fileseq, which takes a while to import."""
        if isinstance(value, frozenset):
            return value
        text = DOTS.sub("-", value).replace(" ", "")
        for first, last in BOUNDS.findall(text):
            if int(first) > int(last):
                between = ".." if last.startswith("-") else "-"
                turned = f"{last}{between}{first}"
                self.fail(f"{first}-{last} runs backwards; write {turned}", param, ctx)
            if int(last) - int(first) >= MOST_FRAMES:
                many = f"'{shorten_value(value)}' names more than {MOST_FRAMES} frames"
                self.fail(f"{many}; name those that there are", param, ctx)
        plain = [PLAIN_RANGE.fullmatch(part) for part in text.split(",")]
        found = [(int(match[1]), int(match[2] or match[1])) for match in plain if match]
        if len(found) == len(plain):
            return frozenset(n for first, last in found for n in range(first, last + 1))
        from fileseq.exceptions import ParseException
        from fileseq.frameset import FrameSet as FrameRange

        try:
            return frozenset(int(n) for n in FrameRange(text))
        except (ParseException, ValueError):
            shown = shorten_value(value)
            self.fail(f"'{shown}' is no frame range; write 1-100, 1-100x2 or 1-3,7", param, ctx)

    def write(self, value: frozenset[int]) -> str:
        """Write a default as users would."""
        return format_ranges(value)


class ShardOf(click.ParamType[tuple[int, int]]):
    """Part i of n."""

    name = "I/N"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, int]:
        """Parse i/n with 1 <= i <= n."""
        if isinstance(value, tuple):
            return value
        index, _, count = str(value).partition("/")
        whole = index.isascii() and count.isascii() and index.isdigit() and count.isdigit()
        if not (whole and 1 <= int(index) <= int(count)):
            self.fail(f"'{shorten_value(value)}' is no shard; write 1/4 to 4/4", param, ctx)
        return int(index), int(count)


class Named(click.ParamType[str]):
    """One of a set of names; an unknown one gets a suggestion."""

    name = "NAME"

    def __init__(self, kind: str, known: Iterable[str]) -> None:
        """Remember what is named, and the names."""
        self._kind = kind
        self._known = tuple(known)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Check the name."""
        if value not in self._known:
            hint = did_you_mean(value, self._known)
            self.fail(f"no {self._kind} is called '{value}'{hint}", param, ctx)
        return str(value)

    def shell_complete(
        self, ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        """Offer the names that begin like this."""
        del ctx, param
        return [CompletionItem(name) for name in self._known if name.startswith(incomplete)]


class Member(click.Choice[E]):
    """A member of an enum, by its value."""

    def __init__(self, kind: type[E], *, without: Iterable[E] = ()) -> None:
        """Offer the members but those of `without`."""
        left_out = frozenset(without)
        super().__init__([member for member in kind if member not in left_out])
        self._kind = kind

    def normalize_choice(self, choice: object, ctx: click.Context | None) -> str:
        """Match values, where click would match the names of members."""
        del ctx
        return str(choice)


class NamedMember(click.ParamType[E]):
    """A member of an enum, by its value; an unknown one gets a suggestion."""

    name = "NAME"

    def __init__(self, what: str, kind: type[E]) -> None:
        """Remember what is named, and the names."""
        self._names = Named(what, kind)
        self._kind = kind

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> E:
        """Check the name."""
        return self._kind(self._names.convert(value, param, ctx))

    def shell_complete(
        self, ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        """Offer the names that begin like this."""
        return self._names.shell_complete(ctx, param, incomplete)


class LayoutChoice(Named):
    """A layout preset, or a TOML file that holds one."""

    name = "NAME|FILE"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Check the name; a file is read, and judged, when the frames are."""
        if str(value).endswith(LAYOUT_SUFFIX):
            return str(value)
        return super().convert(value, param, ctx)

    def shell_complete(
        self, ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        """Offer the names that begin like this, and files where there is none."""
        names = super().shell_complete(ctx, param, incomplete)
        return names or [CompletionItem(incomplete, type="file")]


class TileSide(click.ParamType[int]):
    """Side of a tile: 0 for none, or large enough that its rim is not most of the work."""

    name = "PX"
    smallest = 16

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """Parse, and refuse tiles that are mostly rim."""
        side = click.INT.convert(value, param, ctx)
        if side != 0 and side < self.smallest:
            self.fail(f"{side} is too small; write {self.smallest} or more, or 0", param, ctx)
        return int(side)


class PixelSize(click.ParamType[tuple[int, int]]):
    """Width and height: 1920x1080; given on as (height, width)."""

    name = "WxH"

    def __init__(self, most: int) -> None:
        """Remember the longest side."""
        self._most = most

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, int]:
        """Parse WxH with sides from 1 on."""
        if isinstance(value, tuple):
            return value
        width, _, height = str(value).lower().partition("x")
        whole = all(side.isascii() and side.isdigit() for side in (width, height))
        if not (whole and all(1 <= int(side) <= self._most for side in (width, height))):
            self.fail(f"'{value}' is no size; write 1920x1080", param, ctx)
        return int(height), int(width)

    def write(self, value: tuple[int, int]) -> str:
        """Write a default as users would."""
        height, width = value
        return f"{width}x{height}"


class FiniteRange(click.FloatRange):
    """A number of a range: no NaN, which passes every comparison, and no infinity."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Parse."""
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{value} is no number", param, ctx)
        return number


class RateTile(click.ParamType[int]):
    """Side of a tile of one shading rate: a power of two from 1 to 64."""

    name = "PIXELS"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """Parse."""
        sides = tuple(2**power for power in range(7))
        text = str(value)
        if not text.isdigit() or int(text) not in sides:
            self.fail(f"{text} is none of {', '.join(map(str, sides))}", param, ctx)
        return int(text)


class PixelsPerDegree(click.ParamType[float]):
    """A number, or `width`: as many as the image's width asks for, which 0 stands for."""

    name = "NUMBER|width"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Parse."""
        if value == "width":
            return 0.0
        return FiniteRange(1.0, 1000.0).convert(value, param, ctx)


class ListOption(click.Option):
    """An option whose value is a list with commas; of one that is repeated, the lists add up."""

    def add_to_parser(self, parser: Any, ctx: click.Context) -> None:
        """Collect every value, where click would keep the last."""
        del ctx
        parser.add_option(obj=self, opts=self.opts, dest=self.name, action="append")

    def type_cast_value(self, ctx: click.Context, value: Any) -> Any:
        """Convert the values as the one list that they make."""
        joined = ",".join(value) if isinstance(value, list) else value
        return super().type_cast_value(ctx, joined)


FOLDER = click.Path(path_type=Path)

RATE_TILE = RateTile()
PPD = PixelsPerDegree()

input_folder = click.argument("in_folder", metavar="IN", type=FOLDER)
output_folder = click.argument("out_folder", metavar="OUT", type=FOLDER)

frames = click.option(
    "--frames",
    cls=ListOption,
    type=Frames(),
    help="Write these frames only; history still reads the others.",
)
shard = click.option("--shard", type=ShardOf(), help="Write part I of N of each shot.")
layout = click.option(
    "--layout",
    type=LayoutChoice("layout", LAYOUT_NAMES),
    help="Channel layout, or a TOML file of one's own; detected by default.",
)
layer = click.option(
    "--layer",
    metavar="NAME",
    help="View layer, stereo view or group of channels that is read of files with several.",
)
view = click.option(
    "--view", metavar="NAME", help="Stereo view that is read, of that layer if one is named."
)
capture = click.option(
    "--capture",
    "capture_file",
    type=FOLDER,
    metavar="FILE",
    help="Declarations in place of the shot's capture.toml.",
)
jobs = click.option(
    "--jobs",
    type=click.IntRange(1, MOST_JOBS),
    default=2,
    show_default=True,
    help="Threads that read, and threads that write.",
)
overwrite = click.option(
    "--overwrite", is_flag=True, help="Replace files that are stale or not rtsr's."
)
runtime = click.option(
    "--runtime",
    type=Member(Runtime),
    show_default=True,
    help="What computes the network; onnx: onnxruntime, files of rtsr export.",
)
model = click.option(
    "--model",
    type=FOLDER,
    metavar="DIR",
    help="Folder that rtsr export wrote, for --runtime onnx.",
)
on_missing = click.option(
    "--on-missing",
    type=Member(MissingPolicy),
    default=MissingPolicy.ERROR.value,
    show_default=True,
    help="Frames without a file, or without a buffer that the others have and the run needs.",
)
on_nonfinite = click.option(
    "--on-nonfinite",
    type=Member(NonfinitePolicy),
    default=NonfinitePolicy.ERROR.value,
    show_default=True,
    help="NaN and Inf in an input.",
)
dry_run = click.option("--dry-run", is_flag=True, help="Check everything, write nothing.")


def _remember_json(ctx: click.Context, _: click.Parameter, value: bool) -> bool:
    """Let the group know, so that it says an error that ends the command as an event, too."""
    ctx.meta[JSON_CHOSEN] = value
    return value


as_json = click.option(
    "--json", "as_json", is_flag=True, callback=_remember_json, help="One event a line, as JSON."
)


def _set_verbosity(ctx: click.Context, param: click.Parameter, value: int) -> int:
    """Move the level of what is said: plans and summaries are INFO, channels DEBUG."""
    del ctx
    step = 10 if param.name == "quiet" else -10
    logger = logging.getLogger("rtsr")
    logger.setLevel(logger.level + step * value)
    return value


verbose = click.option(
    "-v",
    "--verbose",
    count=True,
    callback=_set_verbosity,
    expose_value=False,
    help="Also say which channel is which buffer.",
)
quiet = click.option(
    "-q",
    "--quiet",
    count=True,
    callback=_set_verbosity,
    expose_value=False,
    help="Say nothing but warnings and errors.",
)


def frame_options(function: F) -> F:
    """Options of every command that reads frames."""
    for option in (
        quiet,
        verbose,
        as_json,
        dry_run,
        on_nonfinite,
        on_missing,
        jobs,
        shard,
        frames,
        capture,
        view,
        layer,
        layout,
    ):
        function = option(function)
    return function


def describe_rates(captured: Sequence[str]) -> str:
    """Say which shading rates were captured."""
    return f"captured rates {', '.join(captured)}" if captured else "emulated rates"


def emit(event: dict[str, Any]) -> None:
    """Print one JSON event; bytes of names that are not UTF-8 are named in it as escapes."""
    click.echo(json.dumps(make_all_visible(event), sort_keys=True, default=_write_plain))


def _write_plain(value: object) -> str:
    return str(make_all_visible(str(value)))


def take_defaults_of(request: type) -> Callable[[click.Command], click.Command]:
    """Give a command's options the defaults of a request's fields, as a user would write them."""
    values = {field.name: field.default for field in fields(request)}

    def set_defaults(command: click.Command) -> click.Command:
        for param in command.params:
            value = values.get(param.name or "", MISSING)
            if value is not MISSING and value is not None and not param.multiple:
                param.default = _format_as_user(param.type, value)
        return command

    return set_defaults


def _format_as_user(kind: click.ParamType[Any], value: object) -> object:
    """Return a default as users would write it: members by value, commas between several."""
    if isinstance(value, StrEnum):
        return value.value
    if isinstance(value, tuple) and all(isinstance(member, str) for member in value):
        return ",".join(value)
    write = getattr(kind, "write", None)
    return value if write is None else write(value)


def request_from(request: type[R], chosen: Mapping[str, Any]) -> R:
    """Make a request of options of the same names as its fields.

    Raises:
        UsageError: they do not go together.
    """
    named = {field.name for field in fields(request)}  # type: ignore[arg-type]
    try:
        return request(**{name: value for name, value in chosen.items() if name in named})
    except RequestError as error:
        raise click.UsageError(str(error)) from error
