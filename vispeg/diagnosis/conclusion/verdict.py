"""Derive the verdict of a search.

- adequate: the user's model is at the noise floor, and no effect was added.
- identified: effects were added, and no rival of them explains the held-out recordings as well.
- ambiguous: at least one of them has such a rival.
- unexplained: too much of the error remains, or it cannot be judged.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from vispeg.core.rules import RULES
from vispeg.diagnosis.evidence.remainder import Dependence
from vispeg.diagnosis.evidence.roles import Roles
from vispeg.diagnosis.findings import Rivals, Verdict, left_unexplained
from vispeg.diagnosis.scale import floors, times


def decide(
    before: float,
    after: float,
    n_added: int,
    rivals: Sequence[Rivals],
    depends: Sequence[Dependence],
    floor: float = 1.0,
    mark: float | None = None,
    farthest: float | None = None,
    n_read: int = 0,
    errors: tuple[float, float] | None = None,
) -> Verdict:
    """Return the verdict.

    Args:
        before, after: held-out mean squared whitened residual (error over noise) of the user's model and of the final
            one; 1 at the noise floor.
        n_added: number of effects added.
        rivals: of the added effects.
        depends: inputs that the final residual depends on, strongest first.
        floor: held-out mean squared whitened residual that the right model would leave; above 1 if encoders are coarse
            or the loop feeds noise back.
        mark: held-out mean squared whitened residual that least squares of all base parameters, friction and bias
            leaves; None if unknown.
        farthest: mean squared whitened residual over its own floor, of the kind of reading (angles, torques or loads)
            that the final model describes worst; by default `after` over `floor`.
        n_read: number of added effects that were read directly from the measured angles, not fitted.
        errors: held-out RMS errors of the two models over the noise floor, as in the ladder, for the text; by default
            the roots of `before` and `after`.
    """
    first, last = errors or (np.sqrt(before), np.sqrt(after))
    explained, at_floor = _explained(before, after, floor), after <= RULES.adequate * floor
    top = depends[0] if depends else None
    if unexplained(before, after, n_added, floor, mark, farthest):
        on = [{"input": d.input, "joint": d.joint, "share": d.share} for d in depends if d.share >= RULES.depends]
        what = f"it depends on {on[0]['input']} at {on[0]['joint']}" if on else "no single input predicts it"
        text = f"an error of {times(last)} × the noise floor remains that no known effect explains; {what}"
        if farthest is not None and farthest > RULES.far:
            kind = "the kind of reading (angles, torques or loads) that is described worst"
            text += f"; {kind} is at {floors(farthest)} × its own noise floor"
        if mark is not None:
            over = f"over all readings the model leaves {floors(after)} × their noise"
            text += f"; {over}, least squares of all masses, friction and bias leaves {floors(mark)} ×"
        return left_unexplained(text, on, explained_share=round(explained, 4))
    if not n_added:
        text = f"the held-out error is {times(last)} × the noise floor"
        coarse = _of_readings(floor) if after <= floor else ""
        return Verdict("adequate", text + (coarse or " and no effect lowers it"))
    names = [r.label for r in rivals if r.equals]
    if names:
        return Verdict("ambiguous", confounded(names), partial=not at_floor)
    remainder = (
        ""
        if at_floor
        else f"; {100 * explained:.1f} % of the excess is explained"
        + (f", the rest depends most on {top.input}" if top is not None and top.share >= RULES.depends else "")
    )
    remainder += _of_readings(floor)
    if at_floor and n_added == n_read:
        text = (
            f"the readings lie on a grid; the held-out error of {times(last)} × the noise floor is what its steps leave"
        )
        return Verdict("identified", text)
    return Verdict(
        "identified", f"held-out error fell from {times(first)} to {times(last)} × the noise floor{remainder}"
    )


def undecided(roles: Roles, before: float, after: float, floor: float) -> Verdict:
    """Return the verdict where one recording alone shows what the model lacks.

    Args:
        roles: with the name of that recording, `alone`, and the sentence on it, `note`.
        before, after, floor: as in `decide`.
    """
    share = round(_explained(before, after, floor), 4) if before > floor else 0.0
    return left_unexplained(roles.note, explained_share=share, shows_in=roles.alone)


def confounded(names: Sequence[str], by: str = "recordings") -> str:
    """Return the reason for `ambiguous`: the labels of effects that have equals."""
    return f"these {by} cannot tell {', '.join(sorted(set(names)))} from other effects"


def without_tentative(verdict: Verdict, rivals: Sequence[Rivals], unsure: Collection[str]) -> Verdict:
    """Return an ambiguous verdict with a reason that leaves out tentative effects (`unsure`), as the page does.

    Other verdicts are returned unchanged.
    """
    names = [r.label for r in rivals if r.equals]
    if verdict.verdict != "ambiguous" or verdict.reason != confounded(names):
        return verdict
    certain = [name for name in names if name not in unsure]
    text = confounded(certain) if certain else "every effect that others explain as well is tentative"
    return replace(verdict, reason=text)


def unexplained(
    before: float,
    after: float,
    n_added: int,
    floor: float = 1.0,
    mark: float | None = None,
    farthest: float | None = None,
) -> bool:
    """Return whether the error exceeds what an adequate or identified model may leave; arguments are as in `decide`."""
    far = (after / floor if farthest is None else farthest) > RULES.far
    far = far or (mark is not None and after > RULES.inertial * mark)
    little = _explained(before, after, floor) < RULES.explained
    return after > RULES.adequate * floor and (little or far or not n_added)


def _explained(before: float, after: float, floor: float) -> float:
    """Return the share of the error above the floor that the final model explains; arguments are as in `decide`."""
    return 1.0 - max(after - floor, 0.0) / max(before - floor, 1e-9)


def _of_readings(floor: float) -> str:
    """Return a clause on the error that coarse or noisy readings leave even of the right model; empty if it is small.

    `floor` is as in `decide`.
    """
    if floor <= 1.05:
        return ""
    return f"; coarse or noisy readings leave {floors(floor)} × the noise floor even of the right model"
