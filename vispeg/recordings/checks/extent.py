"""Decide which excitation that contact effects need is present in recordings and which is lacking.

The same rule serves one recording and several together. The bounds come from a study of each effect's uncertainty after
five seconds of each motion: an effect counts as excited if this uncertainty is far below the size at which it matters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

AIR = 0.8  # s in free air that determine the sensor's zero
TILT = 0.4  # rad of tool tilt in free air that separates the tool's mass and centre from the sensor's zero
LONG = 0.5  # s, least time in a regime for it to count
RATIO = 2.0  # ratio of the largest to the smallest pressing force that separates a compliance from a height
TURN = 0.8  # rad of flange rotation about the vertical while inserted that separates errors of grip and goal
HARD = 60.0  # N, force from which a grip may slip
NEEDS = {  # excitation that an effect may need (`Effect.needs`), in the order in which effects are listed
    "free air": "a while in free air",
    "tilt": "the tool tilted in free air",
    "weighing": "the tool tilted in free air, with and without the held part",
    "press": "a press",
    "two forces": "presses with two forces",
    "two directions": "a slide there and back",
    "blow": "a blow that can be run again",
    "insertion": "an insertion",
    "turned insertions": "insertions with the flange turned between them",
    "hard press": "a press that the grip may not hold",
}


@dataclass(frozen=True)
class Extent:
    """Excitation of contact in one recording, or in several together.

    Attributes:
        begins_free: time in free air at the start, s.
        tilt: greatest tilt of the tool in free air, rad, over recordings that begin with enough free air.
        pressed, slid, inserted: s pressing or sliding, sliding, inserted.
        forces: least and greatest sustained force while pressing or inserted, N; None without such contact.
        sectors: which of 8 direction sectors the tip slid in.
        blows: speeds of the impacts that can be simulated, m/s; None if none can or this was not examined.
        hard: s pressing with `HARD` or more.
        yaw: least and greatest rotation of the flange about the vertical while inserted, rad; None if never inserted.
        goal: whether the believed cell has a goal.
    """

    begins_free: float
    tilt: float
    pressed: float
    slid: float
    inserted: float
    forces: tuple[float, float] | None
    sectors: tuple[int, ...]
    blows: tuple[float, ...] | None
    hard: float
    yaw: tuple[float, float] | None
    goal: bool


def joined(extents: Sequence[Extent]) -> Extent:
    """Combine the excitation of several recordings of the same cell."""
    forces, yaws = [e.forces for e in extents if e.forces], [e.yaw for e in extents if e.yaw]
    blows = [e.blows for e in extents if e.blows is not None]
    return Extent(
        begins_free=max(e.begins_free for e in extents),
        tilt=max(e.tilt for e in extents),
        pressed=sum(e.pressed for e in extents),
        slid=sum(e.slid for e in extents),
        inserted=sum(e.inserted for e in extents),
        forces=(min(low for low, _ in forces), max(high for _, high in forces)) if forces else None,
        sectors=tuple(sorted({s for e in extents for s in e.sectors})),
        blows=tuple(v for speeds in blows for v in speeds) if blows else None,
        hard=sum(e.hard for e in extents),
        yaw=(min(low for low, _ in yaws), max(high for _, high in yaws)) if yaws else None,
        goal=any(e.goal for e in extents),
    )


def lacking(e: Extent) -> dict[str, str]:
    """Return key of `NEEDS` -> what is lacking, "" if nothing; `{other}` is a placeholder for the confounded effect."""
    air = "" if e.begins_free >= AIR else f"only {e.begins_free:.2g} s in free air at the start"
    lean = air or ("" if e.tilt >= TILT else f"the tool was not tilted by {np.degrees(TILT):.0f} deg in free air")
    touched = "" if e.pressed >= LONG or e.inserted >= LONG else "nothing was pressed"
    several = e.forces is not None and e.forces[1] >= RATIO * max(e.forces[0], 1e-9)
    inside = "never inserted and pressed" if e.goal else "no `cell` says where the goal is"
    inside = "" if e.inserted >= LONG else inside
    turned = e.yaw is not None and e.yaw[1] - e.yaw[0] >= TURN
    back = "" if len(e.sectors) >= 2 else "slid in one direction only: slide there and back"
    return {
        "free air": air,
        "tilt": lean,
        # an Extent does not say whether the part was held, so there is always a reason
        "weighing": lean or "cannot be told from {other}: weigh with and without the held part",
        "press": touched,
        "two forces": "" if several else touched or "pressed with one force only: press with 5 and with 20 N",
        "two directions": back if e.slid >= LONG else "nothing slid",
        "blow": lacks_blows(e.blows),
        "insertion": inside,
        "turned insertions": inside
        or ("" if turned else "cannot be told from {other}: insert again with the flange turned by 90 deg"),
        "hard press": "" if e.hard >= 0.2 * LONG else f"never pressed with {HARD:.0f} N",
    }


def lacks_blows(blows: Sequence[float] | None) -> str:
    """Return what recordings lack to identify a contact's damping; "" if nothing.

    Args:
        blows: speeds of the impacts that can be simulated, m/s, over all recordings; None if no recording allows it.
    """
    if blows is None:
        return "blows are run again under a stated controller of mode osc, with a wrench"
    return "" if blows else "nothing was hit from free air"
