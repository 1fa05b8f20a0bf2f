"""What was found of how vectors are stored: the readings, ranked, and which of them are tied."""

from __future__ import annotations

from dataclasses import dataclass, replace

from rtsr_cli.core.frames.motion import Jitter, MotionConvention

EXPLAINS = 0.9
"""The winner's error is below this share of that of taking everything for still, or it is none."""

SIGNIFICANT_T = 3.0
"""Standard errors by which a hypothesis must lie behind to be ruled out."""


LEAST_GAIN = 0.05
"""Vectors that lead to pixels which are less than this share more alike than any two, by less than
`SIGNIFICANT_T` standard errors, lead nowhere."""


@dataclass(frozen=True, kw_only=True)
class MotionCandidate:
    """One hypothesis and what speaks for it.

    Attributes:
        convention: how the vectors would be stored.
        error: mean difference to the neighbour fetched along them; 0 equal, 1 unrelated.
        margin: 1 - best error / this error; 0 for the best.
        significance: that difference in standard errors.
        offsets_px: constant offset that fits best, for each triple.
        same_vectors: the winner's vectors as good as equal, out of another file.
        gain: 1 - error / that of fetching from elsewhere in the picture; None where pictures or
            pixels are too few to tell.
        gain_significance: that difference in standard errors.
    """

    convention: MotionConvention
    error: float
    margin: float
    significance: float
    offsets_px: tuple[Jitter, ...]
    same_vectors: bool = False
    gain: float | None = None
    gain_significance: float = 0.0

    @property
    def leads_nowhere(self) -> bool:
        """Tell whether the vectors fit no better than they would fit unrelated frames."""
        if self.gain is None:
            return False
        return self.gain < LEAST_GAIN and self.gain_significance < SIGNIFICANT_T

    @property
    def tied(self) -> bool:
        """Tell whether the measurement cannot rule this hypothesis out."""
        return self.significance < SIGNIFICANT_T


@dataclass(frozen=True, kw_only=True)
class MotionFinding:
    """The ranked hypotheses; none where nothing moves or the pictures do not tell.

    Attributes:
        candidates: best first.
        unmoved_error: error of taking everything for still, on the same pixels.
        moving: share of the pixels that move.
        triples: frames that were compared with both neighbours.
    """

    candidates: tuple[MotionCandidate, ...]
    unmoved_error: float
    moving: float
    triples: tuple[int, ...]

    @property
    def best(self) -> MotionCandidate | None:
        """The winner, None if there is none or it explains little more than standing still.

        Where the vectors of neighbouring files are alike, those of the frame's own file win.
        """
        if not self.candidates or self.candidates[0].error > EXPLAINS * self.unmoved_error:
            return None
        alike = [c for c in self.candidates if c is self.candidates[0] or c.same_vectors]
        own = [c for c in alike if not c.convention.file_offset]
        tied = [c for c in self.candidates if c.tied]
        return (own or sorted(tied, key=lambda c: abs(c.convention.file_offset)))[0]

    @property
    def ties(self) -> tuple[MotionCandidate, ...]:
        """The winner and those that cannot be told from it, but for those that say the same."""
        best = self.best
        if best is None:
            return ()
        first = self.candidates[0]
        alike = {id(c) for c in self.candidates if c is first or c.same_vectors}
        same = alike if id(best) in alike else set()
        return (best, *(c for c in self.candidates if c.tied and id(c) not in {*same, id(best)}))

    @property
    def alike(self) -> tuple[MotionCandidate, ...]:
        """Those that cannot be told from the one that fits best, though all may fit badly.

        Readings that say the same of neighbouring files are none.
        """
        tied = tuple(c for c in self.candidates if c.tied and not c.same_vectors)
        return tied if len(tied) > 1 else ()

    def of(self, convention: MotionConvention) -> MotionCandidate | None:
        """Return what was measured about a convention; jitter is not part of the hypothesis."""
        plain = replace(convention, jittered=False, jitter_inverted=False)
        return next((c for c in self.candidates if c.convention == plain), None)
