"""Frames as a world predicts them before its sensor, each at the posture that its borders ask for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from vispeg.core.effect import Effect, effect
from vispeg.identify.pictures.sight import Sight
from vispeg.vision.borders import Borders, borders_of
from vispeg.vision.eye import delay_of
from vispeg.vision.geometry import Geometry
from vispeg.vision.predict import Predictor, Rendering, through_sensor
from vispeg.worlds.world import World

MOST = 16  # frames of a sight: figures are means over thousands of pixels
DRAWS = 100_000  # between the seeds of two draws of one frame: more than frames that a recording has
LATER = 0.01  # s over which the camera's speed is taken
SEED = 7  # of what the modelled sensor draws: the same in every world, so that differences are the world's


@dataclass(frozen=True, eq=False)
class Shot:
    """One frame: what was measured, and its prediction before the sensor.

    Attributes:
        number: of the frame in its sight.
        rgb, depth: as measured, None where the frame has none.
        rendering: the prediction.
        borders: of the prediction.
        flow: (n,) px/s by which each border moves along its normal.
        velocity: (6,) m/s and rad/s of the camera in its own axes.
        fixed: (H, W) bool, what stands still in the room.
        again: depth as measured from the same place at another time, None where nothing was held still.
    """

    number: int
    rgb: np.ndarray | None
    depth: np.ndarray | None
    rendering: Rendering
    borders: Borders
    flow: np.ndarray
    velocity: np.ndarray
    fixed: np.ndarray
    again: np.ndarray | None = None

    def sensed(self, world: World, kinds: Callable[[Effect], bool], draw: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Give the predicted picture after those effects of a world: rgb (H, W, 3) uint8, depth (H, W) float32 m.

        Another `draw` is another picture of the same moment.
        """
        sensor = world.only(lambda e: kinds(effect(e.effect)))
        seed = SEED + self.number + DRAWS * draw
        return through_sensor(sensor, self.rendering, seed, self.velocity, bend=False)


def shots_of(predictor: Predictor, sight: Sight, world: World, posture: np.ndarray) -> list[Shot]:
    """Give the frames of a sight, `MOST` at most, evenly spread.

    Args:
        predictor: of the cell.
        sight: what was photographed.
        world: as the borders found it.
        posture: (frames, nj) rad to add to the measured angles: where the borders put the arm in each frame.
    """
    predictor.see(world)
    name, late, out = sight.camera.name, -delay_of(world, sight.camera.name), []
    for i in np.linspace(0, len(sight) - 1, min(MOST, len(sight))).round().astype(int):
        (before,), (q,), (after,) = (sight.at(np.array([i]), late + t) for t in (-LATER, 0.0, LATER))
        if not np.isfinite([before, q, after]).all():
            continue
        picture = predictor.draw(name, q + posture[i])
        borders = borders_of(picture, predictor.geometry, step=3.0)
        velocity, flow = _motion(predictor.geometry, name, borders, before + posture[i], after + posture[i])
        measured = sight.rgb(int(i)), sight.depth(int(i))
        fixed, again = _fixed(predictor, picture), sight.again(int(i))
        out.append(Shot(int(i), *measured, picture, borders, flow, velocity, fixed, again))
    return out


def _motion(
    geometry: Geometry, name: str, borders: Borders, before: np.ndarray, after: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(6,) speed of the camera in its own axes, and (n,) px/s of the borders along their normals."""
    places, moved = [], []
    for q in (before, after):
        geometry.at(q)
        places.append([np.array(v) for v in geometry.pose(name)])
        moved.append(borders.moved(geometry, name))
    (p, turn), (then, turned) = places
    rotation = Rotation.from_matrix(turn.T @ turned).as_rotvec()
    return np.concatenate([turn.T @ (then - p), rotation]) / (2 * LATER), (moved[1] - moved[0]) / (2 * LATER)


def _fixed(predictor: Predictor, picture: Rendering) -> np.ndarray:
    """(H, W) bool: pixels of parts none of whose geoms move with the arm."""
    geometry = predictor.geometry
    moving = geometry.table[:-1][geometry.model.body_weldid[geometry.model.geom_bodyid] != 0]
    return (picture.parts > 0) & ~np.isin(picture.parts, moving)
