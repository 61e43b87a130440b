"""Choose the recordings that judge: those requested, and one more if they do not show what the model lacks.

Example: a drive saturates in two motions, but the held-out one is a third, on which saturation cannot be judged. Then
one of the two is held out as well. If the drive saturates in a single motion, but in both halves of it, the first half
is fitted and the second judges. If only one half shows it, no data can judge it: that recording is left out of the fit,
so that it does not hide what the others show, until the model explains it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vispeg.core.rules import RULES
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.scale import floors
from vispeg.identify.evidence import Evidence
from vispeg.identify.inverse import evidence_for
from vispeg.identify.loops.soft import without_drift
from vispeg.recordings.differentiate import spanned
from vispeg.recordings.recording import Recording
from vispeg.worlds.world import World


@dataclass(frozen=True)
class Roles:
    """Fitted and held-out recordings, and a note on the choice.

    `alone` is the name of the only recording that shows what the model lacks, set if it cannot be split either, so that
    no held-out data can judge it; else it is empty. It is not fitted if there are others. `converted` are the notes on
    recordings in new roles that a new evidence of them lacks (`Evidence.converted`).
    """

    fitted: Sequence[Recording]
    held_out: Sequence[Recording]
    note: str
    alone: str = ""
    converted: tuple[str, ...] = ()


@dataclass(frozen=True)
class Sides:
    """The two sides of a diagnosis: what is fitted to, and what judges.

    Attributes:
        fitted, held_out: the recordings.
        evidence, judged: the evidence of each.
        roles: set if no requested held-out recording shows what a fitted one shows (`recast`).
        whole: the sides with all fitted recordings, if one is left out of these because it alone shows something.
    """

    fitted: Sequence[Recording]
    held_out: Sequence[Recording]
    evidence: Evidence
    judged: Evidence
    roles: Roles | None
    whole: Sides | None = None

    def outdone(self, world: World) -> Roles | None:
        """Return these recordings, with a note, if one to be fitted is much farther from `world` than all that judge.

        So it shows something that they do not, by which no effect is judged. None if there is no such recording.
        """
        asked = self.whole or self
        loud, errors, judging = louder(asked.evidence, asked.judged, world)
        if not loud:
            return None
        name = asked.fitted[int(np.argmax(errors))].name
        names = ", ".join(r.name for r in self.held_out)
        far = f"{name} is {floors(max(errors))} × the noise floor from the model, {names} {floors(judging)} ×"
        note = f"{far}: what {name} alone shows cannot be judged before another recording shows it"
        return Roles(self.fitted, self.held_out, note, name)

    def part(self, progress: Progress) -> Progress:
        """Return the progress for these roles: saved fits to recordings that judge now must not be used again."""
        if self.roles is None:
            return progress
        return progress.part("fitted " + ", ".join(r.name for r in self.fitted))


def sides(world: World, fitted: Sequence[Recording], held_out: Sequence[Recording], nthread: int) -> Sides:
    """Return the sides of a diagnosis of `world` with these recordings, in other roles where that is needed."""
    evidence, judged = (without_drift(e, world) for e in _both(fitted, held_out, nthread))
    whole = Sides(fitted, held_out, evidence, judged, None)
    roles = recast(world, evidence, judged)
    if roles is None:
        return whole
    both = _both(roles.fitted, roles.held_out, nthread)
    left_out = roles.alone and len(roles.fitted) < len(fitted)
    return Sides(roles.fitted, roles.held_out, *both, roles, whole if left_out else None)


def _both(fitted: Sequence[Recording], held_out: Sequence[Recording], nthread: int) -> tuple[Evidence, Evidence]:
    """Return the evidence of the fitted and of the held-out recordings, compared in the same way."""
    return evidence_for(fitted, nthread, beside=held_out), evidence_for(held_out, nthread, beside=fitted)


def recast(world: World, evidence: Evidence, judged: Evidence) -> Roles | None:
    """Add a judge if fitted recordings show something that no held-out one shows (`louder`); None if none does.

    If several show it, the last of them judges, but never the one that shows most. If only one does, its second half
    judges, provided both halves show it; else it is `alone`, and not fitted if there are others.
    """
    loud, errors, judging = louder(evidence, judged, world)
    if not loud:
        return None
    names = ", ".join(r.name for r in judged.recordings)
    converted = tuple(dict.fromkeys([*evidence.converted, *judged.converted]))
    if len(loud) == 1:
        (only,) = loud
        first, second = halves(only)
        others = [*evidence.recordings, *judged.recordings]
        if (
            spanned(second.time, second.episode) > 2.0 * RULES.settle_observed
            and min(shown(evidence_for([first, second], beside=others), world)) > RULES.loud * judging
        ):
            fitted = [first, *(r for r in evidence.recordings if r is not only)]
            note = (
                f"only {only.name} shows what the model lacks most: its second half judges what is fitted to its first"
            )
            return Roles(fitted, [*judged.recordings, continued(only)], note, converted=converted)
        far = f"{only.name} is {floors(max(errors))} × the noise floor from the model"
        note = f"{far}, and {names} {floors(judging)} ×: what it alone shows cannot be judged before another shows it"
        rest = [r for r in evidence.recordings if r is not only]
        return Roles(rest or evidence.recordings, judged.recordings, note, only.name, converted)
    most = evidence.recordings[int(np.argmax(errors))]
    judge = [r for r in loud if r is not most][-1]
    fitted = [r for r in evidence.recordings if r is not judge]
    note = f"what the model lacks most does not show in {names}, so {judge.name} judges too"
    return Roles(fitted, [*judged.recordings, judge], note, converted=converted)


def louder(evidence: Evidence, judged: Evidence, world: World) -> tuple[list[Recording], list[float], float]:
    """Return the fitted recordings that show something of which no held-out one shows a share.

    Returns:
        recordings whose error is over `RULES.loud` times the greatest held-out one (1 at least), the error of each
        fitted one, and that greatest one: mean squared whitened residuals.
    """
    errors, judging = shown(evidence, world), max([1.0, *shown(judged, world)])
    loud = [r for r, error in zip(evidence.recordings, errors, strict=True) if error > RULES.loud * judging]
    return loud, errors, judging


def halves(rec: Recording) -> tuple[Recording, Recording]:
    """Return the first and the second half of a recording."""
    middle, out = _middle(rec), []
    for name, rows in (("first", slice(None, middle)), ("second", slice(middle, None))):
        out.append(replace(rec.some(rows), path=rec.path.with_name(f"{rec.name}, {name} half")))
    return out[0], out[1]


def _middle(rec: Recording) -> int:
    """Return the index of the first sample of a recording's second half."""
    return len(rec.time) // 2


def continued(rec: Recording) -> Recording:
    """Return the whole of a recording, compared in its second half alone.

    The state at the cut is not known: how far a drive lags behind, which way a gear is wound. Of an arm whose drive
    saturates, a rollout of the correct model from the cut is up to 10,000 noise variances off (43 in a case of
    scripts/bench/hidden_effects), a rollout from the start of the recording 1 to 3.
    """
    second = np.arange(len(rec.time)) >= _middle(rec)
    return replace(rec, compared=second, path=rec.path.with_name(f"{rec.name}, second half"))


def shown(evidence: Evidence, world: World) -> list[float]:
    """Return the mean squared whitened residual (error over noise) of each recording; 1 at the noise floor."""
    total, count = np.zeros((2, len(evidence.recordings)))
    index = {id(r): k for k, r in enumerate(evidence.recordings)}
    for item, squares in zip(evidence.items, evidence.squares(evidence.residuals([world])[0]), strict=True):
        k = index[id(item.recording)]
        total[k] += squares.sum()
        count[k] += item.valid.sum()
    return (total / np.maximum(count, 1)).tolist()
