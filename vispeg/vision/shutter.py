"""When a camera looks: late, row by row, while its shutter is open; and what it then has of a moving arm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import numpy as np

from vispeg.effects.common.light import to_linear
from vispeg.vision.borders import Borders, borders_of
from vispeg.vision.eye import values_of
from vispeg.vision.predict import Predictor, Rendering, encoded
from vispeg.worlds.world import World

DRAWN = ("camera_delay", "rolling_shutter", "lens_distortion")  # in the picture before its sensor gets it
BANDS, EXPOSURES = 8, 5  # strips of a rolling shutter, moments of an open one

Path = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Shutter:
    """When a camera of a world looks.

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
        """Return the values of a camera in a world."""
        taken = (("camera_delay", "delay"), ("rolling_shutter", "readout"), ("motion_blur", "exposure"))
        return cls(*(values_of(world, name, camera).get(param, 0.0) for name, param in taken))

    @property
    def span(self) -> np.ndarray:
        """(2,) s before the stamp is added: of the first light of a frame and of the last."""
        half = 0.5 * (self.readout + self.exposure)
        return np.array([-half, half]) - self.delay

    def moments(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the times, before the stamp is added, of each strip of rows (k,) and of each look within the exposure
        (m,), s.
        """
        strips = self.readout * ((np.arange(BANDS) + 0.5) / BANDS - 0.5) if self.readout else np.zeros(1)
        looks = self.exposure * ((np.arange(EXPOSURES) + 0.5) / EXPOSURES - 0.5) if self.exposure else np.zeros(1)
        return strips - self.delay, looks


def exposed(predictor: Predictor, camera: str, shutter: Shutter, path: Path, time: float) -> Rendering:
    """One frame, each strip of rows at its own time; posture and pose are those of the middle strip.

    Args:
        predictor: in the world that is photographed.
        camera: name.
        shutter: when it looks.
        path: times (n,) s -> joint angles (n, nj) rad that the predictor takes.
        time: s, the stamp.
    """
    return _joined([_open(predictor, camera, path(time + at)) for at in _strips(shutter)])


def exposed_borders(
    predictor: Predictor, camera: str, shutter: Shutter, path: Path, time: float
) -> tuple[Rendering, Borders]:
    """One frame as `exposed` draws it, and its borders: of each strip where they are when its rows are read."""
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
    """(k, m) s before the stamp is added: looks of each strip."""
    strips, looks = shutter.moments()
    return strips[:, None] + looks


def _open(predictor: Predictor, camera: str, postures: np.ndarray) -> Rendering:
    """Return the mean light of some postures (m, nj); depth and part of the middle one."""
    some = [predictor.draw(camera, q) for q in postures]
    middle = some[len(some) // 2]
    if len(some) == 1:
        return middle
    light = np.mean([to_linear(rendering.rgb.astype(np.float32) / 255) for rendering in some], axis=0)
    return replace(middle, rgb=encoded(light))


def _strip_of(height: int, count: int) -> np.ndarray:
    """(height,) the strip that each row belongs to."""
    return np.minimum(np.arange(height) * count // height, count - 1)


def _joined(strips: list[Rendering]) -> Rendering:
    """Return the rows of each strip, the middle one's posture."""
    if len(strips) == 1:
        return strips[0]
    rows = _strip_of(len(strips[0].depth), len(strips))
    at = np.arange(len(rows))
    pictures = {name: np.stack([getattr(s, name) for s in strips])[rows, at] for name in ("rgb", "depth", "parts")}
    return replace(strips[len(strips) // 2], **pictures)
