"""The tests of a trial that all searches share: its effect is present, and shows in the held-out recordings."""

from __future__ import annotations

from typing import cast

from scipy import stats

from vispeg.core.rules import RULES
from vispeg.diagnosis.findings import Gain, Trial
from vispeg.diagnosis.selection.accept import refusal
from vispeg.diagnosis.selection.judge import Judge, adds
from vispeg.diagnosis.selection.prune import needed
from vispeg.diagnosis.selection.searching import ShareTesting
from vispeg.diagnosis.selection.state import State


class Shown:
    """Tests of a trial in a search; a search over other evidence may override them.

    Attributes:
        judge: judge on the held-out recordings.
    """

    judge: Judge

    def shows(self, state: State, trial: Trial) -> bool:
        """Return whether an effect that a trial adds to `state` is present: its interval excludes null."""
        return adds(trial.fit, trial.score.count)

    def holds(self, state: State, trial: Trial) -> bool:
        """Return whether a trial's addition shows in the held-out recordings alone, block by block."""
        gain = self.judge.gain(state.loss, trial.loss)
        return gain.z >= (stats.norm.isf(RULES.level) if gain.relative < RULES.large else RULES.held_out_large)

    def refusal(self, state: State, trial: Trial, level: float, absent: bool) -> str:
        """Return why a fitted trial must be refused; "" if it passes; see `accept.refusal`."""
        return refusal(cast("ShareTesting", self), state, trial, level, absent)

    def needed(self, state: State, index: int, gain: Gain) -> bool:
        """Return whether the held-out recordings need the effect at `index`, which lowers their error by `gain`."""
        return needed(cast("ShareTesting", self), state, index, gain)
