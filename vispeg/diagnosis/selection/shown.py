"""What every search asks of a trial before it may pass: that its effect is there, and shows in held-out recordings."""

from __future__ import annotations

from typing import cast

from vispeg.core.rules import RULES
from vispeg.diagnosis.findings import Gain, Trial
from vispeg.diagnosis.selection.accept import refusal
from vispeg.diagnosis.selection.judge import Judge, adds
from vispeg.diagnosis.selection.prune import needed
from vispeg.diagnosis.selection.searching import Searching
from vispeg.diagnosis.selection.state import State


class Shown:
    """A search's own tests of a trial; evidence of another kind may have others.

    Attributes:
        judge: the held-out recordings.
    """

    judge: Judge

    def shows(self, state: State, trial: Trial) -> bool:
        """Whether an effect that a trial adds to `state` is there: its interval leaves out null."""
        return adds(trial.fit, trial.score.count)

    def holds(self, state: State, trial: Trial) -> bool:
        """Whether what a trial adds shows in the held-out recordings alone, block by block."""
        gain = self.judge.gain(state.loss, trial.loss)
        return gain.z >= (RULES.held_out if gain.relative < RULES.large else RULES.held_out_large)

    def refusal(self, state: State, trial: Trial, level: float, absent: bool) -> str:
        """Why a fitted trial may not pass; empty where it may."""
        return refusal(cast("Searching", self), state, trial, level, absent)

    def needed(self, state: State, index: int, gain: Gain) -> bool:
        """Whether the held-out recordings want the effect at `index`, without which they lose `gain`."""
        return needed(cast("Searching", self), state, index, gain)
