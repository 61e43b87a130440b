"""Render frames as a world predicts them before its sensor, each at the posture fitted to its borders."""

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

MOST = 16  # largest number of frames per sight; few suffice: a figure of the sensor averages thousands of pixels
DRAWS = 100_000  # stride of seeds between two draws of one frame: more than a recording has frames
LATER = 0.01  # s, step of the finite difference for the camera's velocity
SEED = 7  # of the sensor noise: the same in every world, so that differences are due to the world


@dataclass(frozen=True, eq=False)
class Shot:
    """One measured frame, and its prediction before the sensor.

    Attributes:
        number: index of the frame in its sight.
        rgb, depth: as measured, None if absent.
        rendering: the prediction.
        borders: of the prediction.
        flow: (n,) px/s by which each border moves along its normal.
        velocity: (6,) m/s and rad/s of the camera in its own axes.
        fixed: (H, W) bool, pixels of static parts.
        again: another depth picture from the same place, None if the camera did not stand still.
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
        """Return the prediction after some kinds of a world's effects: rgb (H, W, 3) uint8, depth (H, W) float32 m.

        A different `draw` gives another noise realisation of the same moment.
        """
        sensor = world.only(lambda e: kinds(effect(e.effect)))
        seed = SEED + self.number + DRAWS * draw
        # the rendering has the lens's distortion already
        return through_sensor(sensor, self.rendering, seed, self.velocity, bend=False)


def shots_of(predictor: Predictor, sight: Sight, world: World, posture: np.ndarray) -> list[Shot]:
    """Return frames of a sight, at most `MOST`, evenly spaced.

    Args:
        predictor: of the cell.
        sight: frames of one camera.
        world: with the effects that the borders showed.
        posture: (frames, nj) rad to add to the measured angles so that the borders fit in each frame.
    """
    predictor.see(world)
    # `late`: s from the stamp to the exposure, negative if the image is delayed
    name, late, out = sight.camera.name, -delay_of(predictor.world, sight.camera.name), []
    for i in np.linspace(0, len(sight) - 1, min(MOST, len(sight))).round().astype(int):
        (before,), (q,), (after,) = (sight.at(np.array([i]), late + t) for t in (-LATER, 0.0, LATER))
        if not np.isfinite([before, q, after]).all():
            continue
        picture = predictor.draw(name, q + posture[i])
        borders = borders_of(picture, predictor.geometry, step=3.0)  # px
        velocity, flow = _motion(predictor.geometry, name, borders, before + posture[i], after + posture[i])
        measured = sight.rgb(int(i)), sight.depth(int(i))
        fixed, again = _fixed(predictor, picture), sight.again(int(i))
        out.append(Shot(int(i), *measured, picture, borders, flow, velocity, fixed, again))
    return out


def _motion(
    geometry: Geometry, name: str, borders: Borders, before: np.ndarray, after: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the camera's velocity (6,) in its own frame, and the borders' speeds (n,) px/s along their normals."""
    places, moved = [], []
    for q in (before, after):
        geometry.at(q)
        places.append([np.array(v) for v in geometry.pose(name)])
        moved.append(borders.moved(geometry, name))
    (p, turn), (then, turned) = places
    rotation = Rotation.from_matrix(turn.T @ turned).as_rotvec()
    return np.concatenate([turn.T @ (then - p), rotation]) / (2 * LATER), (moved[1] - moved[0]) / (2 * LATER)


def _fixed(predictor: Predictor, picture: Rendering) -> np.ndarray:
    """Return (H, W) bool: pixels of parts without a geom that moves with the arm."""
    geometry = predictor.geometry
    # `table`: the label of each geom, and a last entry for no geom
    moving = geometry.table[:-1][geometry.model.body_weldid[geometry.model.geom_bodyid] != 0]
    return (picture.parts > 0) & ~np.isin(picture.parts, moving)
