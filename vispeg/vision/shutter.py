"""Draw pictures of a moving arm as a camera takes them: late, row by row, over the time that its shutter is open."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import numpy as np

from vispeg.effects.common.light import to_linear
from vispeg.vision.borders import Borders, borders_of
from vispeg.vision.eye import values_of
from vispeg.vision.predict import Predictor, Rendering, encoded
from vispeg.worlds.world import World

DRAWN = ("camera_delay", "rolling_shutter", "lens_distortion")  # effects that are drawn, before the sensor's effects
BANDS, EXPOSURES = 8, 5  # strips of rows of a rolling shutter, moments within an exposure

Path = Callable[[np.ndarray], np.ndarray]  # times (n,) s -> joint angles (n, nj) rad


@dataclass(frozen=True)
class Shutter:
    """The timing of a camera in a world.

    Attributes:
        delay: s from the middle of the exposure to the stamp; below 0 the joint log lags the camera.
        readout: s from the first row to the last.
        exposure: s that it is open.
    """

    delay: float
    readout: float
    exposure: float

    @classmethod
    def of(cls, world: World, camera: str) -> Shutter:
        """Return the timing of a camera in a world; without such effects it is 0."""
        taken = (("camera_delay", "delay"), ("rolling_shutter", "readout"), ("motion_blur", "exposure"))
        return cls(*(values_of(world, name, camera).get(param, 0.0) for name, param in taken))

    @property
    def span(self) -> np.ndarray:
        """Times (2,) s of the first and of the last light of a frame, relative to its stamp."""
        half = 0.5 * (self.readout + self.exposure)
        return np.array([-half, half]) - self.delay

    def moments(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the times (k,) s of the strips of rows from the stamp, and (m,) s of the looks from their strip.

        A look is a moment within the exposure.
        """
        strips = self.readout * ((np.arange(BANDS) + 0.5) / BANDS - 0.5) if self.readout else np.zeros(1)
        looks = self.exposure * ((np.arange(EXPOSURES) + 0.5) / EXPOSURES - 0.5) if self.exposure else np.zeros(1)
        return strips - self.delay, looks


def exposed(predictor: Predictor, camera: str, shutter: Shutter, path: Path, time: float) -> Rendering:
    """Draw one frame, each strip of rows at its own time; posture and pose are those of the middle strip.

    Args:
        predictor: in the world that is photographed.
        camera: name.
        shutter: its timing.
        path: times (n,) s -> joint angles (n, nj) rad that the predictor takes.
        time: s, the stamp.
    """
    return _joined([_open(predictor, camera, path(time + at)) for at in _strips(shutter)])


def exposed_borders(
    predictor: Predictor, camera: str, shutter: Shutter, path: Path, time: float
) -> tuple[Rendering, Borders]:
    """Draw one frame as `exposed` does, and return its borders too, each where it is when its strip of rows is read."""
    strips, pieces = [], []
    for k, at in enumerate(_strips(shutter)):
        rendering = _open(predictor, camera, path(time + at))
        predictor.geometry.at(rendering.q)
        borders, height = borders_of(rendering, predictor.geometry), len(rendering.depth)
        row = np.clip(np.rint(borders.pixel[:, 1]).astype(int), 0, height - 1)
        pieces.append(borders.some(_strip_of(height, len(_strips(shutter)))[row] == k))
        strips.append(rendering)
    columns = ([getattr(b, f.name) for b in pieces] for f in fields(Borders))
    return _joined(strips), Borders(*(np.concatenate(c) for c in columns))


def _strips(shutter: Shutter) -> np.ndarray:
    """Return the times (k, m) s of the looks of each strip, relative to the stamp."""
    strips, looks = shutter.moments()
    return strips[:, None] + looks


def _open(predictor: Predictor, camera: str, postures: np.ndarray) -> Rendering:
    """Return the mean light of some postures (m, nj); depth and part of the middle one."""
    drawn = [predictor.draw(camera, q) for q in postures]
    middle = drawn[len(drawn) // 2]
    if len(drawn) == 1:
        return middle
    light = np.mean([to_linear(rendering.rgb.astype(np.float32) / 255) for rendering in drawn], axis=0)
    return replace(middle, rgb=encoded(light))


def _strip_of(height: int, count: int) -> np.ndarray:
    """Return the strip (height,) that each row belongs to."""
    return np.minimum(np.arange(height) * count // height, count - 1)


def _joined(strips: list[Rendering]) -> Rendering:
    """Return one picture of the rows of all strips; its posture is the middle one's."""
    if len(strips) == 1:
        return strips[0]
    rows = _strip_of(len(strips[0].depth), len(strips))
    at = np.arange(len(rows))
    pictures = {name: np.stack([getattr(s, name) for s in strips])[rows, at] for name in ("rgb", "depth", "parts")}
    return replace(strips[len(strips) // 2], **pictures)
