"""Which system a command uses where none is named, and why those above it in preference cannot."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

from rtsr_cli.core.choices import InputCondition, NonfinitePolicy
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.imaging.derivation import CAMERA
from rtsr_cli.core.network.load import has_weights
from rtsr_cli.core.pairs.point_samples import is_point_sampled
from rtsr_cli.core.pairs.sources import (
    DECLARED_MOTION,
    FITTING_HR,
    HR_FRAMES,
    PairSource,
    name_once,
)
from rtsr_cli.core.run.system_inputs import (
    OF_FRAMES,
    SystemTable,
    describe_likely,
    is_of_frames,
    resolve_system_inputs,
    resolve_unshaded_inputs,
)
from rtsr_cli.core.system import System
from rtsr_cli.core.wording import join_names, say_count

NETWORKS = "networks"
"""What trained systems are called together."""

GIVE_HR = "give G-buffers of the target size (--hr DIR, or --simulate-lr of an HR capture)"
NO_CAMERA = "give the camera matrices (headers, or a file that capture.toml names)"
SOME_FRAMES = "render those frames again, or leave them out (--on-missing skip|hold)"
UNUSED_CAMERA = "the matrices that are there are not used, see the warning"

CHECKS: Mapping[InputCondition, Callable[[PairSource], bool]] = {
    InputCondition.TRUSTED_MOTION: lambda source: source.reader.motion_trusted,
    InputCondition.JITTER: lambda source: source.jitters,
    InputCondition.POINT_SAMPLES: is_point_sampled,
}
"""Whether inputs meet a condition."""


@dataclass(frozen=True, kw_only=True)
class PassedOver:
    """A preferred system that is not the default for some inputs.

    Attributes:
        system: which.
        missing: what the inputs lack, size before each; empty if they lack nothing.
        held: names of the buffers that frames of either size hold.
        reason: what else keeps it back, behind its name: "is not made for 3x".
    """

    system: System
    missing: tuple[str, ...] = ()
    held: frozenset[str] = frozenset()
    reason: str = ""

    @property
    def lacks(self) -> tuple[str, ...]:
        """What is missing, with its size where the other size has it."""
        return name_once(self._name(missing) for missing in self.missing)

    def _name(self, missing: str) -> str:
        plain = _strip_size(missing)
        return missing if plain.partition(OF_FRAMES)[0] in self.held else plain


def _strip_size(missing: str) -> str:
    return missing if missing == HR_FRAMES else missing.removeprefix("lr ").removeprefix("hr ")


def choose_default(
    source: PairSource,
    systems: SystemTable,
    policy: NonfinitePolicy,
    rendered: Collection[int] | None = None,
    *,
    refuse: Callable[[System], str] = lambda system: "",
) -> tuple[System, list[PassedOver]]:
    """Return the first preferred system that can run, and those that are passed over for it.

    Where none can, it is the last one, whose refusal asks for least.

    Args:
        source: the shot's pairs.
        systems: to choose from.
        policy: for NaN and Inf.
        rendered: frames whose radiance is read; all if None.
        refuse: what keeps a system back for this run, behind its name; empty if nothing does.
    """
    passed: list[PassedOver] = []
    for name in systems.preferred:
        system = systems.load(name)
        unfit = refuse(system)
        found = (
            PassedOver(system=system, reason=unfit)
            if unfit
            else judge_preferred(system, source, systems, policy, rendered)
        )
        if found is None:
            return system, passed
        passed.append(found)
    return passed[-1].system, passed[:-1]


def judge_preferred(
    system: System,
    source: PairSource,
    systems: SystemTable,
    policy: NonfinitePolicy,
    rendered: Collection[int] | None = None,
) -> PassedOver | None:
    """Say why a preferred system is not the default for these inputs; None if it may be."""
    scale = source.scale
    if system.scales and scale not in system.scales:
        return PassedOver(system=system, reason=f"not made for {scale}x")
    missing = source.missing(resolve_system_inputs(system, policy), rendered)
    if system.unshaded_inputs:
        others = None if rendered is None else set(source.reader.numbers).difference(rendered)
        unshaded = source.missing(resolve_unshaded_inputs(system, policy), others)
        missing = name_once((*missing, *unshaded))
    if FITTING_HR in missing:
        return PassedOver(system=system, reason=f"the HR G-buffer is not read: {source.misfit}")
    if missing:
        held = frozenset(b.value for reader in source.readers for b in reader.stored)
        return PassedOver(system=system, missing=missing, held=held)
    if not has_weights(system, scale):
        return PassedOver(system=system, reason=f"without weights for {scale}x")
    unmet = [c for c in systems.when.get(system.name, ()) if not CHECKS[c](source)]
    if unmet:
        wanted = " and ".join(_name_condition(c, source) for c in unmet)
        return PassedOver(system=system, reason=f"preferred only with {wanted}")
    return None


def _name_condition(condition: InputCondition, source: PairSource) -> str:
    """The condition, with what is seen against it where that is known."""
    if condition is not InputCondition.TRUSTED_MOTION:
        return condition.value
    if Buffer.MOTION in source.reader.faulty:
        return f"{condition} (something is wrong with it, see the warning)"
    distrust = source.reader.motion_distrust
    return f"{condition} ({distrust})" if distrust else condition.value


def describe_passed_over(source: PairSource, passed: Sequence[PassedOver], chosen: System) -> str:
    """Say in one line what keeps the better systems back; empty if there are none.

    Args:
        source: the shot's pairs.
        passed: systems that are preferred.
        chosen: that runs in their place; where it is a network, networks are not named as all.
    """
    groups: dict[object, list[PassedOver]] = {}
    for one in passed:
        groups.setdefault(frozenset(one.lacks) or one.reason, []).append(one)
    if not groups:
        return ""
    trained = {o.system.name for o in passed if o.system.learning is not None and o.missing}
    trained = trained if chosen.learning is None else set()
    refused = any(reader.camera_unfit for reader in source.readers)
    texts: list[str] = []
    said: set[str] = set()
    longest: tuple[str, ...] = ()
    for members in groups.values():
        lacks = members[0].lacks
        apart = {one.system.name for one in passed} - {one.system.name for one in members}
        who = join_names(name_together([one.system for one in members], trained, apart))
        if not lacks:
            texts.append(f"{who}: {members[0].reason}")
            continue
        divided = Buffer.MATERIAL.value in members[0].held
        remedies = suggest_remedies(lacks, refused=refused, divided=divided)
        advice = ", ".join(remedy for remedy in remedies if remedy not in said)
        what = _describe_lacks(lacks, longest, plural=len(members) > 1)
        texts.append(f"{who} {what}{advice and ': '}{advice}")
        said.update(remedies)
        longest = max(longest, lacks, key=len)
    likely = describe_likely(source.readers, [name for one in passed for name in one.missing])
    found = say_count(len(source.reader.stored), "buffer")
    return f"{found} found; better systems are passed over: {'; '.join(texts)}{likely}"


def _describe_lacks(lacks: Collection[str], longest: Collection[str], *, plural: bool) -> str:
    """Name all that systems lack, by what they do not lack of a list just given if that is less."""
    spared = [name for name in longest if name not in lacks]
    verb = "need" if plural else "needs"
    if set(lacks) < set(longest) and len(spared) < len(lacks):
        return f"{verb} all of that but {join_names(spared)}"
    return f"{verb} {join_names(list(lacks))}"


def name_together(
    systems: Iterable[System], trained: set[str], apart: Collection[str] = ()
) -> list[str]:
    """Name systems in few words: all trained ones as networks, others by what names share.

    Args:
        systems: to name.
        trained: names of all trained systems that lack something.
        apart: names of systems of which something else is said: no pattern may cover them.
    """
    given = list(systems)
    names = [system.name for system in given]
    whole = len(trained) > 1 and trained <= set(names)
    left = [n for n in names if not (whole and n in trained)]
    stems = [name.partition("-")[0] for name in left]
    covered = {name.partition("-")[0] for name in apart if "-" in name}
    named = dict.fromkeys(
        f"{stem}-*" if stems.count(stem) > 1 and "-" in name and stem not in covered else name
        for name, stem in zip(left, stems, strict=True)
    )
    return [*named, *([NETWORKS] if whole else [])]


CONSTANTS = frozenset({Buffer.METALLIC.value, Buffer.ROUGHNESS.value})
"""What may be one number for a whole scene."""

SURFACE = CONSTANTS | {Buffer.ALBEDO.value, Buffer.MATERIAL.value, Buffer.NOV.value}
"""What material follows from."""


def suggest_remedies(
    lacks: Collection[str], *, refused: bool = False, divided: bool = False
) -> tuple[str, ...]:
    """Say in a few words each what would help against all that is missing.

    Args:
        lacks: what is missing, with or without its size.
        refused: whether there are camera matrices that are not used.
        divided: whether material is there: what is lacking is then asked for by itself.
    """
    partial = set(filter(is_of_frames, lacks))
    given = set(lacks) - partial
    names = set(map(_strip_size, given))
    if names and names.isdisjoint(given):
        return (f"the other size has {_say_it(names)}: render both alike",)
    cameras = set(filter(_is_camera, names))
    parts = [GIVE_HR] if HR_FRAMES in names else []
    parts += [UNUSED_CAMERA if refused else NO_CAMERA] if cameras else []
    parts += [SOME_FRAMES] if partial else []
    left = names - cameras - {HR_FRAMES}
    if not left:
        return tuple(parts)
    if left <= CONSTANTS and not divided:
        return (*parts, "declare constants or material")
    if left <= SURFACE and not divided:
        return (*parts, "declare material")
    verb = "declare" if left == {DECLARED_MOTION} else "render or declare"
    return (*parts, f"{verb} {'the rest' if parts else _say_it(left)}")


def _is_camera(name: str) -> bool:
    return _strip_size(name).startswith(CAMERA)


def _say_it(names: Collection[str]) -> str:
    return "it" if len(names) == 1 else "them"
