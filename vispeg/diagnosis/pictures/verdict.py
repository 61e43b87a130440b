"""The verdict on pictures: what is left decides before what was found."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vispeg.diagnosis.conclusion.rivals import Rivals
from vispeg.diagnosis.conclusion.verdict import Verdict
from vispeg.diagnosis.evidence.remainder import CONVINCING
from vispeg.diagnosis.pictures.halves import Halves
from vispeg.diagnosis.pictures.remainder import VISIBLE, Left
from vispeg.diagnosis.pictures.sensors import Sensed
from vispeg.identify.pictures.coarse import SHIFTS, TURNS

MARKED, LARGE = 0.03, 1.0  # share, and px: of several times what pictures without such a fault leave
LOST = 0.5  # share of the predicted borders without an edge near, from which on the pictures show something else


def decide(
    before: float,
    after: float,
    n_added: int,
    rivals: Sequence[Rivals],
    remainder: Sequence[Left],
    halves: Halves | None,
    lost: float,
) -> Verdict:
    """The verdict.

    Args:
        before, after: held-out misplacement of the borders, RMS px.
        n_added: effects added.
        rivals: of the added effects.
        remainder: what the remainder depends on.
        halves: whether two halves of the views agree.
        lost: share of predicted borders that the held-out pictures have no edge at.
    """
    convincing = [x for x in remainder if _convinces(x)]
    on = [{"input": x.input, "joint": x.where, "share": round(x.share, 3), "px": round(x.size, 2)} for x in convincing]
    if convincing:
        top = convincing[0]
        text = f"{top.size:.1f} px are left that no known effect explains; they depend on {top.input}: {top.where}"
        return Verdict("unexplained", text, {"depends_on": on, "text": text}, partial=True)
    if halves is not None and halves.disagree:
        text = (
            f"two halves of the views differ by {halves.difference:.2f} px where {halves.uncertainty:.2f} px are their "
            "uncertainty: no model of this form fits both"
        )
        return Verdict("unexplained", text, {"depends_on": on, "text": text}, partial=True)
    if lost > LOST:
        far = f"{100 * SHIFTS.max():.0f} cm and {np.degrees(TURNS.max()):.0f} degrees"
        text = f"{100 * lost:.0f} % of the predicted borders have no edge near them in the pictures: they show another "
        text += f"cell, or a camera that is farther off than the {far} within which it is looked for"
        return Verdict("unexplained", text, {"depends_on": on, "text": text}, partial=True)
    if not n_added:
        return Verdict(
            "adequate", f"borders lie within {after:.2f} px of where they are predicted; no effect lowers it"
        )
    names = sorted(r.label for r in rivals if r.equals)
    if names:
        return Verdict("ambiguous", f"these views cannot tell {', '.join(names)} from other effects")
    return Verdict("identified", f"held-out borders moved from {before:.2f} to {after:.2f} px from their edges")


def _convinces(x: Left) -> bool:
    """A share that counts, or a shift that nothing else makes: many edges of a moved part are no longer near it."""
    return (x.share >= CONVINCING and x.size >= VISIBLE) or (x.share >= MARKED and x.size >= LARGE)


def with_sensor(borders: Verdict, sensed: Sequence[Sensed]) -> Verdict:
    """The verdict on borders, with what the same pictures say of the sensor."""
    added = [s for s in sensed if s.added]
    if borders.verdict == "unexplained" or not added:
        return borders
    names = sorted(r.label for s in added for r in s.rivals if r.equals)
    if names or borders.verdict == "ambiguous":
        text = f"these views cannot tell {', '.join(names)} from other effects" if names else borders.reason
        return Verdict("ambiguous", text)
    falls = [f"{s.kind} from {s.errors[0]:.1f} to {s.errors[1]:.1f} times its scatter" for s in added]
    said = [borders.reason] if borders.verdict == "identified" else []
    return Verdict("identified", "; ".join([*said, f"held-out figures of {' and of '.join(falls)}"]))
