"""How far recordings go in what effects of contact need, and what they lack of it: one rule for one and for many.

The bounds follow a study of how well each effect is known after five seconds of each motion: one is excited where that
is far better than the sizes at which it matters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

AIR = 0.8  # s in free air that determine the sensor's zero
TILT = 0.4  # rad that the tool must be tilted in free air to tell its mass and centre from the sensor's zero
LONG = 0.5  # s in a regime that is enough to tell something
RATIO = 2.0  # of the largest press to the smallest, to tell a compliance from a height
TURN = 0.8  # rad that the flange must be turned about its axis in contact to tell grip from goal
HARD = 60.0  # N from which a grip may slip
NEEDS = {  # what an effect needs (`Effect.needs`), in the order in which effects are listed
    "free air": "a while in free air",
    "tilt": "the tool tilted in free air",
    "weighing": "that, with and without the held part",
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
    """Extent of one recording, or of several together.

    Attributes:
        begins_free: s in free air at the start.
        tilt: rad, the greatest of the tool in free air, of what begins with enough of that.
        pressed, slid, inserted: s pressing or sliding, sliding, inserted.
        forces: N, of what presses or is inserted the least and the greatest for a while; None where nothing is.
        sectors: of 8, those in which the tip slid.
        blows: m/s, speeds of those that can be run again; None where the recording cannot, or nobody looked.
        hard: s pressing with `HARD` or more.
        yaw: least and greatest turn of the flange about the vertical where it inserts, rad; None where it does not.
        goal: whether a goal is believed in.
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


def joined(some: Sequence[Extent]) -> Extent:
    """Join several recordings: what each shows of the same cell adds up."""
    forces, yaws = [e.forces for e in some if e.forces], [e.yaw for e in some if e.yaw]
    again = [e.blows for e in some if e.blows is not None]
    return Extent(
        begins_free=max(e.begins_free for e in some),
        tilt=max(e.tilt for e in some),
        pressed=sum(e.pressed for e in some),
        slid=sum(e.slid for e in some),
        inserted=sum(e.inserted for e in some),
        forces=(min(low for low, _ in forces), max(high for _, high in forces)) if forces else None,
        sectors=tuple(sorted({s for e in some for s in e.sectors})),
        blows=tuple(v for blows in again for v in blows) if again else None,
        hard=sum(e.hard for e in some),
        yaw=(min(low for low, _ in yaws), max(high for _, high in yaws)) if yaws else None,
        goal=any(e.goal for e in some),
    )


def lacking(e: Extent) -> dict[str, str]:
    """Key of `NEEDS` -> what is lacking of it, "" for nothing; `{other}` stands for what looks the same."""
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
        blows: of those that can be run again, in any recording; None where none of the recordings can.
    """
    if blows is None:
        return "blows are run again under a stated controller of mode osc, with a wrench"
    return "" if blows else "nothing was hit from free air"
