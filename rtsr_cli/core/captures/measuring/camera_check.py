"""Checking camera matrices: their form, and whether what the files show agrees with them.

Matrices that fail as given, though another reading of them fits, are not used. Where nothing can
tell, they are unverified, and nothing else is measured by them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from rtsr_cli.core.captures.measuring.camera_evidence import CameraEvidence, Errors, mean_error
from rtsr_cli.core.captures.measuring.camera_hypotheses import (
    CameraReading,
    Cameras,
    list_readings,
    list_worlds,
)
from rtsr_cli.core.captures.measuring.camera_refinement import (
    OF_LENS,
    Beside,
    find_beside,
    list_told,
    say_untold,
)
from rtsr_cli.core.captures.measuring.camera_structure import (
    CameraMatrices,
    Matrix4,
    are_mirrored,
    find_view_fault,
    is_sound,
)
from rtsr_cli.core.captures.measuring.position_evidence import PositionEvidence
from rtsr_cli.core.frames.camera_convention import CameraConvention, CameraWord
from rtsr_cli.core.frames.camera_needs import say_frames
from rtsr_cli.core.frames.selection import format_ranges

ALIKE = 2.0
"""Of readings whose errors are within this factor of the best one's, the simplest is named."""


LEAST_SAID = 1e-3
"""Smaller errors are of the last digits, and said as none."""


@dataclass(frozen=True, kw_only=True)
class CameraFinding:
    """What was found out about camera matrices.

    Attributes:
        unfit: why they are not used; empty if they are.
        declared: words of `[camera] convention` that would make them right; empty if none would.
        doubt: why they are unverified; empty if they are not.
        disputed: whether that is because something does not agree with them.
        stuck: whether they are one frame's in all, though what is seen moves.
        beside: whether a camera a little beside them explains what they do not.
        strays: why those of single frames are in doubt; empty if none are.
        single: whether matrices are unfit of single frames alone.
        foreign_positions: in which frames positions are another frame's; empty if in none.
        proofs: what agrees with them.
        undecided: what they might be as well, by all that is known.
        errors: of each kind of evidence, in its own unit.
        position_unit_m: metres in a unit of world positions, where they agree.
        certain: whether axes and order are proven, so that others may be measured by them.
        contradiction: what of another world does not agree with them; empty if nothing does.
        normal_world: axes A under which normals stand on their surfaces, n . A; None where they do
            as they are, or under none.
    """

    unfit: str = ""
    declared: str = ""
    doubt: str = ""
    disputed: bool = False
    stuck: bool = False
    beside: bool = False
    strays: str = ""
    single: bool = False
    foreign_positions: str = ""
    proofs: tuple[str, ...] = ()
    undecided: tuple[str, ...] = ()
    errors: Mapping[str, float] = field(default_factory=dict)
    position_unit_m: float | None = None
    certain: bool = False
    contradiction: str = ""
    normal_world: Matrix4 | None = None

    @property
    def fits(self) -> bool:
        """Tell whether something agrees with the matrices."""
        return bool(self.proofs) and not self.unfit

    @property
    def likenesses(self) -> str:
        """What they might be as well, for the user; empty if nothing."""
        return ", or ".join(_word_likeness(text) for text in self.undecided)


@dataclass(frozen=True, kw_only=True)
class _Trial:
    """How the readings fare before one kind of evidence."""

    evidence: CameraEvidence
    errors: Errors
    """Of the matrices as given."""
    pairs: Mapping[int, tuple[float, float]]
    """By index of the reading: its error, and that of the matrices as given on the same frames."""
    spread: frozenset[int] = frozenset()
    """Indices of the readings that are better in most of the frames, and not for one of them."""

    @property
    def own(self) -> float:
        return mean_error(self.errors.values())

    @property
    def fits(self) -> bool:
        return self.own <= self.evidence.limit

    @property
    def wrong(self) -> list[int]:
        """Numbers of the frames that do not fit; all where only the mean of them does not."""
        apart = [n for n, error in self.errors.items() if error > self.evidence.limit]
        return apart or list(self.errors)

    def is_better(self, index: int, *, backed: bool) -> bool:
        """Tell whether a reading fits where the matrices as given do not, by far.

        Args:
            index: of the reading.
            backed: whether all that tells more agrees with it, and with the matrices as given: by
                chance it would not.
        """
        error, own = self.pairs.get(index, (float("inf"), 0.0))
        slack = self.evidence.slack
        most = self.evidence.limit if backed else self.evidence.sure
        better = own > max(self.evidence.factor * error, error + slack)
        return error <= most and better and index in self.spread

    def is_worse(self, index: int) -> bool:
        """Tell whether a reading is ruled out."""
        error, own = self.pairs.get(index, (0.0, 0.0))
        return error > max(self.evidence.factor * own, own + self.evidence.slack)


@dataclass(frozen=True, kw_only=True)
class _Rival:
    """A reading that fits where the matrices as given do not."""

    trial: _Trial
    index: int
    reading: CameraReading

    def is_closer(self, other: _Rival) -> bool:
        """Tell whether this one fits the same kind of evidence better, beyond doubt."""
        error, rival = self.trial.pairs[self.index][0], other.trial.pairs[other.index][0]
        same = self.trial.evidence.name == other.trial.evidence.name
        return same and error + self.trial.evidence.slack < rival

    def describe(self) -> str:
        error, own = self.trial.pairs[self.index]
        return (
            f"by {self.trial.evidence.name}, {_format(own, self.trial)} as given and "
            f"{_format(error, self.trial)} in that reading"
        )


def check_cameras(
    given: Cameras,
    evidence: Sequence[CameraEvidence],
    *,
    step: int,
    convention: CameraConvention,
    silent: Sequence[str] = (),
    of_lens: bool = False,
) -> CameraFinding:
    """Hold the matrices of some frames against all that can tell.

    Args:
        given: by frame; of neighbours of the frames that are looked at, too.
        evidence: the strongest first; empty where nothing tells.
        step: numbers from a frame to the next.
        convention: as it was declared, and taken into account.
        silent: why what is there is no evidence, for the user.
        of_lens: whether clip space is made of worldToCamera and a field of view.
    """
    readings = list_readings(given, step, of_lens=of_lens)
    faults = {number: fault for number, m in given.items() if (fault := _find_fault(m))}
    if faults:
        chosen = _choose_sound(readings, evidence)
        fault = next(iter(faults.values()))
        alike = [number for number, other in faults.items() if other == fault]
        text = _describe_unfit(_say_of(alike, given), fault, chosen, convention)
        return CameraFinding(unfit=text, declared=_list_words(chosen, convention))
    trials = _try_all(evidence, given, readings)
    foreign = _find_foreign(trials, given)
    if foreign:
        kept = [e.without(foreign) if isinstance(e, PositionEvidence) else e for e in evidence]
        checked = check_cameras(
            given, kept, step=step, convention=convention, silent=silent, of_lens=of_lens
        )
        return replace(checked, foreign_positions=_describe_foreign(foreign, trials))
    errors = {t.evidence.name: t.own for t in trials}
    found = _find_rival(trials, readings)
    if found.reading.mirrors_world if found is not None else _is_world_doubtful(given, trials):
        worlds = list_worlds(given)
        tellers = [t.evidence for t in trials if t.evidence.tells_world]
        others = [t for t in trials if not t.evidence.tells_world]
        other = _find_rival(_try_all(tellers, given, worlds), worlds, others)
        if found is None or (other is not None and other.is_closer(found)):
            found = other
    if found is not None:
        where = _say_of(found.trial.wrong, found.trial.errors)
        text = _describe_unfit(where, "", found.reading, convention, found.describe())
        declared = _list_words(found.reading, convention)
        # where positions are of another world, too, normals alone mend nothing
        alone = not any(t.evidence.tells_step and t.evidence.tells_world for t in trials)
        world = found.reading.world if alone and found.trial.evidence.tells_world else None
        return CameraFinding(unfit=text, declared=declared, errors=errors, normal_world=world)
    lone = _find_lone(trials, given, [r for r in readings if r.of_neighbour])
    if lone:
        return CameraFinding(unfit=lone, single=True, errors=errors)
    return _judge_unopposed(given, readings, trials, errors, (*silent, *_list_too_few(evidence)))


def check_normals(found: CameraFinding, given: Cameras, evidence: CameraEvidence) -> CameraFinding:
    """Hold normals that matrices were not checked by against matrices that something agrees with.

    Args:
        found: of the matrices.
        given: matrices of some frames.
        evidence: the normals with depth.
    """
    if not found.fits or found.contradiction:
        return found
    return _add_contradiction(found, given, _try_all([evidence], given, ()))


def _list_too_few(evidence: Sequence[CameraEvidence]) -> Iterator[str]:
    """Say what cannot be compared; asked where nothing at all could be."""
    for one in evidence:
        yield f"{one.name} are of too few pixels, or of frames without neighbours"


def _find_fault(matrices: CameraMatrices) -> str:
    fault = find_view_fault(matrices.view)
    if fault:
        return f"worldToCamera {fault}"
    if not is_sound(matrices):
        return "worldToNDC is not worldToCamera times a projection of a camera that looks along -z"
    return ""


def _try_all(
    evidence: Sequence[CameraEvidence], given: Cameras, readings: Sequence[CameraReading]
) -> list[_Trial]:
    return [t for e in evidence if (t := _try_readings(e, given, readings)) is not None]


def _is_world_doubtful(given: Cameras, trials: Sequence[_Trial]) -> bool:
    """Tell whether the world's axes may be others: matrices mirror, or what tells it disagrees."""
    mirrored = bool(are_mirrored(next(iter(given.values())).view))
    return any(t.evidence.tells_world and (mirrored or not t.fits) for t in trials)


def _try_readings(
    evidence: CameraEvidence, given: Cameras, readings: Sequence[CameraReading]
) -> _Trial | None:
    own = evidence.measure(given, closely=False)
    if not own:
        return None
    mean = mean_error(own.values())
    closely = mean <= evidence.slack
    pairs, spread = {}, set()
    for index, reading in enumerate(readings):
        # a frame's vectors from the one before are those to it under the next frame's matrices
        alone = closely and not reading.of_neighbour
        errors = evidence.measure(reading.cameras, closely=alone)
        # vectors may be about the next frame in one reading, about the one before in another
        common = (errors.keys() & own.keys() or errors.keys() | own.keys()) if errors else ()
        if common:
            pairs[index] = tuple(mean_error(e[n] for n in common if n in e) for e in (errors, own))
            same = errors.keys() & own.keys()
            improved = [n for n in same if own[n] > errors[n] + evidence.slack]
            if 2 * len(improved) > len(same) or not same:
                spread.add(index)
    return _Trial(evidence=evidence, errors=own, pairs=pairs, spread=frozenset(spread))  # type: ignore[arg-type]


def _find_lone(trials: Sequence[_Trial], given: Cameras, shifted: Sequence[CameraReading]) -> str:
    """Say which frames' matrices fail where those of most frames agree; empty if none do.

    Motion tells of two frames at once: one that has a part in what agrees is right, or all of those
    are the next ones'.

    Args:
        trials: the strongest first.
        given: the matrices.
        shifted: readings that take them for those of the frames beside.
    """
    for trial in trials:
        evidence = trial.evidence
        own = evidence.measure(given, closely=False)
        wrong = {n for n, error in own.items() if error > evidence.limit}
        agreeing = own.keys() - wrong
        if not evidence.tells_step or not wrong or len(agreeing) <= len(wrong):
            continue
        parts = _list_parts(evidence, given, own)
        lone = [n for n, told in parts.items() if told & wrong and not told & agreeing]
        if lone:
            worst, usual = (mean_error(own[n] for n in part) for part in (wrong, agreeing))
            beside = [evidence.measure(r.cameras, closely=False) for r in shifted]
            open_ = any(
                told and mean_error(told) <= evidence.limit
                for told in ([e[n] for n in agreeing & e.keys()] for e in beside)
            )
            others = " (or are all a neighbouring frame's)" if open_ else ""
            return (
                f"the camera matrices are not used: those of {say_frames(lone)} do not agree with "
                f"what is seen, though those of the other frames do{others} (by {evidence.name}, "
                f"{_format(worst, trial)} there and {_format(usual, trial)} elsewhere): matrices "
                f"of another frame, or an axis flipped? {OTHER_FRAME.capitalize()}"
            )
    return ""


def _list_parts(evidence: CameraEvidence, given: Cameras, own: Errors) -> dict[int, set[int]]:
    """By the frame of a camera, the frames of which it tells."""
    return {
        n: own.keys() - evidence.measure(_leave_out(given, n), closely=False).keys() for n in given
    }


def _find_foreign(trials: Sequence[_Trial], given: Cameras) -> list[int]:
    """Frames whose positions fail where motion agrees with their cameras, and most positions do."""
    positions = next((t for t in trials if isinstance(t.evidence, PositionEvidence)), None)
    if positions is None:
        return []
    limit = positions.evidence.limit
    wrong = [n for n, error in positions.errors.items() if error > limit]
    if not wrong or 2 * len(wrong) >= len(positions.errors):
        return []
    for trial in trials:
        if trial is positions or not trial.evidence.tells_step:
            continue
        agrees = {n for n, error in trial.errors.items() if error <= trial.evidence.limit}
        parts = _list_parts(trial.evidence, given, trial.errors)
        if all(parts[n] and parts[n] <= agrees for n in wrong):
            return wrong
    return []


def _describe_foreign(wrong: Sequence[int], trials: Sequence[_Trial]) -> str:
    trial = next(t for t in trials if isinstance(t.evidence, PositionEvidence))
    worst = mean_error(trial.errors[n] for n in wrong)
    usual = mean_error(error for n, error in trial.errors.items() if n not in wrong)
    return (
        f"world positions of {say_frames(wrong)} are not those of the pixels that show them "
        f"({_format(worst, trial)}, {_format(usual, trial)} elsewhere), though motion with depth "
        "agrees with the camera matrices there: positions of another frame? The matrices are used; "
        "write each frame's own positions"
    )


def _leave_out(given: Cameras, number: int) -> Cameras:
    return {n: matrices for n, matrices in given.items() if n != number}


def _find_rival(
    trials: Sequence[_Trial], readings: Sequence[CameraReading], others: Sequence[_Trial] = ()
) -> _Rival | None:
    """The reading that fits where the matrices as given do not, by what tells most.

    Args:
        trials: the strongest first.
        readings: that were tried.
        others: trials that all of these readings fare alike in.
    """
    for number, trial in enumerate(trials):
        above = [*others, *trials[:number]]
        stronger = [t for t in above if t.fits]
        backed = 0 < len(stronger) == len(above)
        # the others know nothing of these readings, and number others alike
        telling = [t for t in trials[:number] if t.fits]
        better = [
            i
            for i in range(len(readings))
            if trial.is_better(i, backed=backed) and not any(t.is_worse(i) for t in telling)
        ]
        if better:
            chosen = _choose_simplest(trial, better)
            return _Rival(trial=trial, index=chosen, reading=readings[chosen])
    return None


def _choose_simplest(trial: _Trial, better: Sequence[int]) -> int:
    """The first of the readings that fit about as well as the best of them."""
    best = min(trial.pairs[i][0] for i in better)
    least = max(min(ALIKE, trial.evidence.factor) * best, best + trial.evidence.slack)
    return next(i for i in better if trial.pairs[i][0] <= least)


def _choose_sound(
    readings: Sequence[CameraReading], evidence: Sequence[CameraEvidence]
) -> CameraReading | None:
    """Of the sound readings, the one that fits; the simplest where nothing tells."""
    for one in evidence:
        errors = [mean_error(one.measure(r.cameras, closely=False).values()) for r in readings]
        if errors and min(errors) <= one.limit:
            return readings[errors.index(min(errors))]
    return next((r for r in readings if not r.mirrors_world), None)


def _judge_unopposed(
    given: Cameras,
    readings: Sequence[CameraReading],
    trials: Sequence[_Trial],
    errors: Mapping[str, float],
    silent: Sequence[str],
) -> CameraFinding:
    proofs = [t for t in trials if t.fits]
    mirrored = bool(are_mirrored(next(iter(given.values())).view))
    plausible = [i for i, r in enumerate(readings) if mirrored or not r.mirrors_world]
    open_ = [i for i in plausible if not any(t.is_worse(i) for t in proofs)]
    own = [i for i in open_ if not readings[i].of_neighbour]
    told = len(open_) < len(plausible)
    nearby = ((t.evidence.name, t.evidence.view_nearby(given)) for t in trials)
    views = {name: view for name, view in nearby if view is not None}
    beside = {name: b for name, view in views.items() if (b := find_beside(view)) is not None}
    # what agrees is no proof where something that tells more does not
    if not proofs or not told or not trials[0].fits or beside:
        said = _describe_doubt(trials, silent, beside, mirrored=mirrored, resting=_rest(given))
        doubt = " ".join(said)
        stuck = _rest(given) and any(t.evidence.tells_step and not t.fits for t in trials)
        return CameraFinding(
            doubt=doubt,
            disputed=bool(beside) or any(not t.fits for t in trials),
            stuck=stuck,
            beside=bool(beside),
            errors=errors,
        )
    if mirrored and any(not readings[i].mirrors_world for i in own):
        # what agrees as well with a camera that does not mirror speaks for that one
        doubt = " ".join(_describe_mirrored(proofs, [readings[i] for i in own]))
        return _add_contradiction(CameraFinding(doubt=doubt, errors=errors), given, trials)
    undecided = dict.fromkeys(_shorten(readings[i]) for i in (*own, *open_))
    if _rest(given) and not any(t.evidence.tells_step for t in proofs):
        # where one camera is in all frames, no neighbour's is another reading
        undecided[OF_NEIGHBOUR] = None
    if _rest(given) and not any(t.evidence.tells_lens for t in proofs):
        undecided[OF_OTHER_LENS] = None
    proving = [views[t.evidence.name] for t in proofs if t.evidence.name in views]
    seen = {name for view in proving for name in list_told(view)}
    seen |= {OF_LENS} if OF_OTHER_LENS in undecided else set()
    undecided |= dict.fromkeys(say_untold(seen) if proving else ())
    found = CameraFinding(
        proofs=tuple(t.evidence.name for t in proofs),
        undecided=tuple(undecided),
        errors=errors,
        certain=not own,
    )
    return _add_contradiction(found, given, trials)


def _add_contradiction(
    found: CameraFinding, given: Cameras, trials: Sequence[_Trial]
) -> CameraFinding:
    """Say what would stand in another world by far better, and in which, if anything would."""
    for trial in trials:
        if trial.fits or not trial.evidence.tells_world:
            continue
        worlds = list_worlds(given)
        errors = [
            mean_error(trial.evidence.measure(w.cameras, closely=False).values()) for w in worlds
        ]
        best = min(errors, default=math.inf)
        if best <= trial.evidence.limit and ALIKE * best < trial.own:
            world = worlds[errors.index(best)]
            text = (
                f"{trial.evidence.name} of {say_frames(trial.errors)} do not agree with the camera "
                f"matrices ({_format(trial.own, trial)} as given, {_format(best, trial)} where "
                f"matrices are {world.text}): axes of the world swapped or "
                "negated between normals and cameras? Angles of view, which demodulation divides "
                f"by, would be wrong; {OTHER_WORLD}"
            )
            of_normals = None if trial.evidence.tells_step else world.world
            return replace(found, contradiction=text, normal_world=of_normals)
    return found


def _describe_mirrored(proofs: Sequence[_Trial], others: Sequence[CameraReading]) -> Iterator[str]:
    names = " and ".join(t.evidence.name for t in proofs)
    likenesses = dict.fromkeys(_word_likeness(_shorten(r)) for r in others)
    yield f"{UNVERIFIED}: {names} cannot tell them from {', or '.join(likenesses)}."
    yield from (MIRROR, NOTHING_MEASURED)


OF_NEIGHBOUR = "those of a neighbouring frame"
OF_OTHER_LENS = "those of another field of view"
"""Where a camera rests, nothing moves by it, whatever its lens."""


def _rest(given: Cameras) -> bool:
    """Tell whether one camera is in all frames."""
    return len(given) > 1 and len({m.digits for m in given.values()}) == 1


def _shorten(reading: CameraReading) -> str:
    if reading.of_neighbour:
        return OF_NEIGHBOUR
    return "of a mirrored world" if reading.mirrors_world else reading.text


UNVERIFIED = "the camera matrices are unverified"

MIRROR = "They mirror: world and camera space are of different handedness."

NOTHING_MEASURED = "No other convention is measured by them; rtsr's own is in docs/frames.md."


def _describe_doubt(
    trials: Sequence[_Trial],
    silent: Sequence[str],
    beside: Mapping[str, Beside],
    *,
    mirrored: bool,
    resting: bool,
) -> Iterator[str]:
    apart = [t for t in trials if not t.fits]
    if apart or beside:
        listed = "; ".join(_say_apart(t) for t in apart)
        yield (
            f"{UNVERIFIED}: what the frames show does not agree with them"
            f"{f' ({listed})' if listed else ''}."
        )
        if resting and any(t.evidence.tells_step for t in apart):
            # other frames' cameras are beside it, and that is no error of its own
            yield (
                "They are the same in all frames, though what is seen moves: one frame's matrices "
                "in every frame? Write each frame's own."
            )
        else:
            # one says it: what tells most
            yield from [_describe_beside(name, found) for name, found in beside.items()][:1]
    elif trials:
        yield f"{UNVERIFIED}: nothing in these frames moves or turns so that it could tell."
    elif silent:
        yield f"{UNVERIFIED}: what is there cannot tell: {'; '.join(silent)}."
    else:
        yield (
            f"{UNVERIFIED}: nothing in the files can tell: that takes world positions, depth with "
            "motion that is read, or depth with normals of the world that face several ways."
        )
    if mirrored:
        yield MIRROR
    yield NOTHING_MEASURED


def _describe_beside(name: str, found: Beside) -> str:
    depth = " (or is depth stored otherwise than it is read?)" if "depth" in name else ""
    return (
        f"By {name} they look like those of a camera beside the one that rendered: "
        f"{found.describe()}. Write the renderer's own{depth}."
    )


def _say_apart(trial: _Trial) -> str:
    """Say by how much one kind of evidence is off, and in which of the frames looked at."""
    wrong = trial.wrong
    right = [n for n in trial.errors if n not in wrong]
    off = _format(mean_error(trial.errors[n] for n in wrong), trial)
    said = f"{trial.evidence.name}: {off} in {_say_of(wrong, trial.errors)}"
    if not right:
        return said
    return f"{said}; {_format(mean_error(trial.errors[n] for n in right), trial)} in " + say_frames(
        right
    )


def _say_of(numbers: Sequence[int], looked_at: Iterable[int]) -> str:
    """Name frames, and say where they are all that are known."""
    every = len(numbers) > 1 and set(looked_at) <= set(numbers)
    return f"all frames looked at ({format_ranges(numbers)})" if every else say_frames(numbers)


def _format(error: float, trial: _Trial) -> str:
    if error >= 1e8:
        return "behind the camera"
    return f"{error if error >= LEAST_SAID else 0:.3g} {trial.evidence.unit}"


def _describe_unfit(
    where: str,
    fault: str,
    reading: CameraReading | None,
    convention: CameraConvention,
    proof: str = "",
) -> str:
    """One message: what is wrong with the matrices, what they look like, the remedy."""
    said = f" (read as declared: {convention})" if convention.words else ""
    looks = () if reading is None else (f"worldToCamera looks {_word_look(reading)}",)
    first = f"the camera matrices of {where} are not used{said}: "
    found = ": ".join((*looks, fault or proof))
    remedy = OTHER_WORLD if reading is not None and reading.mirrors_world else OWN
    remedy = OTHER_FRAME if reading is not None and reading.of_neighbour else remedy
    if reading is not None and _is_undone(convention, reading):
        remedy = UNDECLARE
    return f"{first}{found}; {remedy}{_word_declaration(reading, convention)}"


OWN = "write row vectors of a camera with x right, y up that looks along -z (docs/frames.md)"

UNDECLARE = (
    "take the line [camera] convention out of capture.toml: what the files hold is right without it"
)

OTHER_FRAME = "write each frame's own"

OTHER_WORLD = (
    "write matrices of the world that positions and normals are in (docs/frames.md), or, if it is "
    "their channels that are mixed up, name those in the order x, y, z ([buffers] normal, position)"
)


def _is_undone(convention: CameraConvention, reading: CameraReading) -> bool:
    """Tell whether a reading takes back all that is declared."""
    declared = set(convention.words) - {CameraWord.ROW_VECTORS, CameraWord.OPENGL}
    return bool(declared) and declared == set(reading.undoes)


def _word_likeness(text: str) -> str:
    """Name matrices that might be meant as well."""
    if text.startswith("those"):
        return text
    if text.startswith("of "):
        return f"ones {text}"
    plain = text.startswith(("transposed", "inverted", "turned"))
    return f"ones that look {text}" if plain else f"ones that look like {text}"


def _word_look(reading: CameraReading) -> str:
    text = reading.text
    plain = text.startswith(("transposed", "inverted"))
    return text if plain else f"like {text}" if not text.startswith("of ") else f"like that {text}"


def _word_declaration(reading: CameraReading | None, convention: CameraConvention) -> str:
    words = _list_words(reading, convention)
    return words and f', or declare [camera] convention = "{words}" in capture.toml'


def _list_words(reading: CameraReading | None, convention: CameraConvention) -> str:
    """What declares a reading; empty if something is declared already, or nothing could."""
    return "" if reading is None or convention.words else ", ".join(reading.words)
