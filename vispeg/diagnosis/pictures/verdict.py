"""Decide the verdict on pictures: `unexplained` if an error remains, even if effects were found."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vispeg.core.rules import RULES
from vispeg.diagnosis.conclusion.verdict import confounded, unexplained
from vispeg.diagnosis.findings import Rivals, Verdict, left_unexplained
from vispeg.diagnosis.pictures.halves import Halves
from vispeg.diagnosis.pictures.remainder import Left
from vispeg.diagnosis.pictures.sensors import Sensed
from vispeg.identify.pictures.coarse import SHIFTS, TURNS


def decide(
    before: float,
    after: float,
    floor: float,
    n_added: int,
    rivals: Sequence[Rivals],
    remainder: Sequence[Left],
    halves: Halves | None,
    lost: float,
    moved: tuple[str, float] | None = None,
    field: float = 0.0,
) -> Verdict:
    """Return the verdict; the first error that remains, in the order of the code, is its reason.

    Args:
        before, after: held-out misplacement of the borders, RMS px; 0 if no border is in view.
        floor: RMS px expected of a correct model.
        n_added: effects added.
        rivals: of the added effects.
        remainder: inputs that the residual depends on, strongest first.
        halves: whether two halves of the views agree.
        lost: share of predicted borders without an edge in the held-out pictures.
        moved: the object whose position differs most between held-out and fitted recordings, and the distance, mm;
            None if none is visible in both.
        field: shift of the edges, RMS px, that depends on image position alone and that the alignment could not remove.
    """
    convincing = [x for x in remainder if _convinces(x)]
    if field >= RULES.shift_px:
        text = f"edges are shifted by {field:.1f} px (RMS), by amounts that depend on their position in the image "
        text += "and not on the frame: a smear or streak on the lens, or a lens that the model cannot describe"
        return _unexplained(text, convincing)
    if convincing:
        top = convincing[0]
        return _unexplained(
            f"{top.size:.1f} px are left that no known effect explains; they depend on {top.input}: {top.where}",
            convincing,
        )
    if halves is not None and halves.disagree:
        return _unexplained(
            f"fits to two halves of the views differ by {halves.difference:.2f} px, with an uncertainty of "
            f"{halves.uncertainty:.2f} px: no model of this form fits both"
        )
    if lost > RULES.lost:
        far = f"{100 * SHIFTS.max():.0f} cm and {np.degrees(TURNS.max()):.0f} degrees"
        text = f"{100 * lost:.0f} % of the predicted borders have no edge near them in the pictures: they show another "
        return _unexplained(text + f"cell, or the camera is outside the search range of {far} about its nominal pose")
    if moved is not None and moved[1] > 1e3 * RULES.moved_sigma * RULES.thing_known[0]:
        text = f"the {moved[0]} stands {moved[1]:.1f} mm elsewhere in the held-out recordings than in the fitted ones"
        return _unexplained(f"{text}: what stands in the cell was moved in between")
    if unexplained((before / floor) ** 2, (after / floor) ** 2, n_added):
        text = f"borders lie {after:.2f} px from where they are predicted, {after / floor:.1f} times what a right model"
        return _unexplained(text + " leaves, and no known effect explains it")
    if not n_added:
        found = f"borders lie within {after:.2f} px of where they are predicted" if after else "no border is in view"
        return Verdict("adequate", f"{found}; no effect lowers it" if after else found)
    names = [r.label for r in rivals if r.equals]
    if names:
        return Verdict("ambiguous", confounded(names, "views"))
    return Verdict("identified", f"held-out borders moved from {before:.2f} to {after:.2f} px from their edges")


def _unexplained(text: str, on: Sequence[Left] = ()) -> Verdict:
    """Return the verdict `unexplained` with its reason and the inputs that the remaining error depends on."""
    depends = [{"input": x.input, "joint": x.where, "share": round(x.share, 3), "px": round(x.size, 2)} for x in on]
    return left_unexplained(text, depends)


def _convinces(x: Left) -> bool:
    """Return whether a dependence proves an error: by its share, or by a shift that only a moved part makes.

    Many edges of a moved part are too far from their borders to be found, so its share may be small.
    """
    return (x.share >= RULES.depends and x.size >= RULES.shift_px) or (
        x.share >= RULES.moved_share and x.size >= RULES.moved_px
    )


def with_sensor(borders: Verdict, sensed: Sequence[Sensed]) -> Verdict:
    """Return the verdict on borders combined with the sensor search: `unexplained` if either leaves an error."""
    if borders.verdict == "unexplained":
        return borders
    for s in sensed:
        figure, before, after = s.worst
        if unexplained(before**2, after**2, len(s.added)):
            text = f"{s.kind}: {figure} deviates {after:.1f} times as much as between good cameras, and no known "
            return _unexplained(text + "effect explains it")
    added = [s for s in sensed if s.added]
    if not added:
        return borders
    names = [r.label for s in added for r in s.rivals if r.equals]
    alike = [said for s in added for said in s.alike]
    if names or alike or borders.verdict == "ambiguous":
        undecided = [confounded(names, "views")] if names else []
        first = [borders.reason] if borders.verdict == "ambiguous" else []
        return Verdict("ambiguous", "; ".join([*first, *undecided, *alike]))
    said = [borders.reason] if borders.verdict == "identified" else []
    return Verdict("identified", "; ".join([*said, *(s.fall for s in added)]))
