"""What every search asks of a trial before it may pass: that its effect is there, and shows in held-out recordings."""

from __future__ import annotations

from vispeg.diagnosis.selection.accept import HELD_OUT
from vispeg.diagnosis.selection.judge import Judge, adds
from vispeg.diagnosis.selection.state import State, Trial


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
        return self.judge.gain(state.loss, trial.loss).z >= HELD_OUT
