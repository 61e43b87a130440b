"""The convex pieces of a goal: which of them carry the contact of a part, and their combined stiffness.

The goal's walls are n wedges. A part of width w within walls at a distance a from the axis touches an arc about as long
as it is wide, of a circle of radius a + w: `n w / (2 pi (a + w))` wedges, an estimate. Each is as stiff as a flat wall,
so a jammed part would meet walls that many times too stiff; inside, the stiffness is divided by this number. On the rim
of the mouth, where the part slides from one wedge to the next, the stiffness is unchanged, because a part that sinks in
meets the sides of wedges. Beside the mouth one geom replaces the tops of all pieces, so that a soft part meets no sides
at all.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from scipy.ndimage import uniform_filter1d

from vispeg.contact.hand import PRIORITY
from vispeg.contact.path import Path, tips
from vispeg.effects.common.parts import shapes
from vispeg.effects.common.solref import times
from vispeg.effects.contact.contact_stiffness import scaled
from vispeg.robots.furniture import TOUCHED, UNTOUCHED
from vispeg.robots.scene import Scene

BELOW = 1e-3  # m below the mouth at which a tip that rests on the top may still be measured
SLIDES = 0.01  # m/s, horizontal speed above which a tip slides
STEADY = 0.02  # s over which the position is averaged before its speed is taken
LEAST = 0.03  # smallest share to which a contact's damping is reduced
# places of a tip: over the mouth or its rim; inside, below the bevel; on the block beside the rim; there and sliding
OVER, INSIDE, BESIDE, ALONG = range(4)


class Pieces:
    """The goal's pieces in a batch of hands. They take their contact parameters from the held part.

    In a contact MuJoCo uses the parameters of the geom with the higher priority. The pieces have it, but effects write
    to the held part.

    Args:
        batch: the batch, after the effects were written to it.
        model: its nominal model.
        scene: the hand.

    Attributes:
        top: ids of the geom that replaces the tops of all pieces; empty if the goal has none.
        parts: ids of the walls and plates that it replaces.
        ruling: ids of the geoms whose contact parameters count.
        touched: the batch's `geom_contype`, (nworld, ngeom).
        law: the batch's `geom_solref` and `geom_solimp`, (nworld, ngeom, 2) and (nworld, ngeom, 5).
        alone, together, sliding: the pair of values for `law` of one piece, of those that share a load, and of one
            along which a part slides.
    """

    def __init__(self, batch: Any, model: mujoco.MjModel, scene: Scene):
        names = [model.geom(g).name for g in range(model.ngeom)]
        self.top = [g for g, name in enumerate(names) if name == scene.top]
        self.parts = [g for g, name in enumerate(names) if name.startswith((scene.wall, scene.plate))]
        self.ruling = [g for g in range(model.ngeom) if model.geom_priority[g] == PRIORITY]
        held, width = shapes(model, scene.held)[:1], scene.config.diameter  # effects write all of its shapes alike
        self.touched = batch.expand("geom_contype")
        friction, solref, solimp = (batch.expand(f"geom_{name}") for name in ("friction", "solref", "solimp"))
        friction[:, self.ruling] = friction[:, held]
        self.law = solref, solimp
        ref, imp = solref[:, held].copy(), solimp[:, held].copy()
        walls = len(set(self.ruling) - set(self.top))
        bears_on = max(1.0, walls * width / (2 * np.pi * (scene.config.apothem + width)))
        self.alone, self.together = (ref, imp), scaled(ref, imp, 1 / bears_on)
        self.sliding = less_damped(ref, np.minimum(1.0, odds(imp) / odds(model.geom_solimp[held]))), imp

    def at(self, place: int) -> None:
        """Set the geoms that a part with its tip at a place may touch, and their contact parameters."""
        beside = place in (BESIDE, ALONG)
        if self.top:
            self.touched[:, self.top] = TOUCHED if beside else UNTOUCHED
            self.touched[:, self.parts] = UNTOUCHED if beside else TOUCHED
        law = {INSIDE: self.together, ALONG: self.sliding}.get(place, self.alone)
        for values, new in zip(self.law, law, strict=True):
            values[:, self.ruling] = new


def odds(solimp: np.ndarray) -> np.ndarray:
    """Return `d / (1 - d)` of `solimp` (..., 5); stiffness at rest is proportional to it (see `contact_stiffness`)."""
    return solimp[..., 0] / (1 - solimp[..., 0])


def less_damped(solref: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Return `solref` (..., 2) of the same stiffness with damping reduced to a `share` (...), at least `LEAST`.

    In MuJoCo's contact law a part that slides at speed v is lifted by `mu v b / k` (friction mu, damping b, stiffness
    k), because friction and the damper's force are coupled (Todorov 2014, Convex and analytically-invertible dynamics
    with contacts, ICRA). In the cell that is 0.1 mm at 60 mm/s, which would hide a soft contact. The hand's own dampers
    stay.
    """
    return times(solref, damping=np.maximum(share, LEAST))


def tip_places(path: Path, scene: Scene) -> np.ndarray:
    """Return the place of the part's tip at each sample of a path, (n,): `OVER`, `INSIDE`, `BESIDE` or `ALONG`.

    The nominal goal of `scene`, the cell, is used: an effect that moves the goal by less than the distance to the part
    does not matter.
    """
    tip, config = tips(path, scene), scene.config
    far, corner = np.hypot(tip[:, 0], tip[:, 1]), 2**0.5 if config.shape == "square" else 1.0
    inside = (tip[:, 2] < -max(config.chamfer, BELOW)) & (far < config.apothem)
    beside = (far > corner * (config.apothem + config.chamfer + config.diameter / 2)) & (far < config.block)
    steady = uniform_filter1d(tip[:, :2], max(1, round(STEADY / path.step)), axis=0)
    speed = np.linalg.norm(np.gradient(steady, path.step, axis=0), axis=1)
    return np.select([inside, beside & (speed > SLIDES), beside], [INSIDE, ALONG, BESIDE], OVER)


def stretches(place: np.ndarray, window: slice) -> list[slice]:
    """Return the window of samples, split where the place (n,) changes."""
    cuts = np.flatnonzero(np.diff(place[window])) + window.start + 1
    return [slice(a, b) for a, b in zip([window.start, *cuts], [*cuts, window.stop], strict=True)]
