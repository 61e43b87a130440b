"""Summarise colour pictures: light level, vignetting, blur of borders at rest and in motion, noise.

Colours and lights of a cell are unknown, so only figures that hardly depend on them are used. Vignetting compares one
place of the room in several frames, blur is measured at borders between parts, and noise is simulated on the smoothed
measured picture itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.rules import RULES
from vispeg.identify.channels import shows
from vispeg.identify.pictures.figure import Figure
from vispeg.identify.pictures.links import Links, links_of
from vispeg.identify.pictures.shots import SEED, Shot
from vispeg.vision.blur import softness
from vispeg.vision.depth import depth_residual
from vispeg.vision.eye import values_of
from vispeg.vision.predict import TO_LINEAR, through_sensor
from vispeg.vision.search import search
from vispeg.worlds.world import World

LEVELS = np.array([8, 40, 90, 160, 245])  # code values: edges of the bins of brightness
FEW = 60  # fewest pixels for a figure
EDGES = 30  # fewest border points for a blur
FAST = 60.0  # px/s along the normals, least spread of border speeds that shows motion blur
STILL = 1.0  # px/s, below which a border counts as still
QUIET = 0.2  # quantile of local scatter: the quietest places have noise but no texture
GRAIN = 3.8  # code values, standard deviation of an ordinary camera's noise: 1.5 % of the range
WINDOW = 3.0  # px within which the edge of a border is searched
NOISE, MOTION = "rgb_noise", "motion_blur"


def table() -> tuple[Figure, ...]:
    """Return the figures of light."""
    return (
        Figure("light", RULES.figure_light),
        Figure("red", RULES.figure_colour),
        Figure("blue", RULES.figure_colour),
        Figure("fall-off", RULES.figure_light),
        Figure("softness", RULES.figure_softness),
        Figure("smear", (1e3 * RULES.figure_exposure) ** 2 / 12),
        *(Figure(f"noise, bin {k}", RULES.figure_noise) for k in range(len(LEVELS) - 1)),
    )


class LightFigures:
    """Figures of the frames that have colour.

    Args:
        shots: the frames.
        lit: whether the rendered appearance is that of the room; only then is the light level informative.
    """

    def __init__(self, shots: Sequence[Shot], lit: bool):
        self.table, self.lit = table(), lit
        self.shots = [s for s in shots if s.rgb is not None]
        pictures = [s.rgb for s in self.shots if s.rgb is not None]
        self.links: Links = links_of(self.shots)
        self.smooth = [_smooth(p) for p in pictures]
        self.measured = self._figures(pictures, pictures, 0.0)

    def modelled(self, world: World) -> np.ndarray:
        """Return the figures of the predicted pictures after a world's effects on light."""
        still = _at_rest(world)
        pictures = [s.sensed(still, _of_light)[0] for s in self.shots]
        return self._figures(pictures, self._noisy(world), self._exposure(world))

    def _exposure(self, world: World) -> float:
        """Return the exposure time of the camera, s."""
        return values_of(world, MOTION, self.shots[0].rendering.eye.believed.name).get("exposure", 0.0)

    def _noisy(self, world: World) -> Sequence[np.ndarray]:
        """Return the measured pictures, smoothed, with a world's noise instead of their own."""
        noise = world.only(lambda e: e.effect == NOISE)
        if not noise.effects:
            return self.smooth
        out = []
        for shot, smooth in zip(self.shots, self.smooth, strict=True):
            out.append(through_sensor(noise, replace(shot.rendering, rgb=smooth), SEED + shot.number)[0])
        return out

    def _figures(self, pictures: Sequence[np.ndarray], grain: Sequence[np.ndarray], seconds: float) -> np.ndarray:
        """Return the figures (frames, figures) of `pictures`; their noise is that of `grain`, exposed for `seconds`."""
        fall = self.links.slopes([TO_LINEAR[p][..., 1] for p in pictures])
        rows = []
        for shot, picture, rough, slope in zip(self.shots, pictures, grain, fall, strict=True):
            gain = _gains(picture, shot) if self.lit else np.full(3, np.nan)
            rows.append(np.concatenate([gain, [slope], _softness(picture, shot, seconds), _grain(rough, shot)]))
        return np.array(rows)


def _of_light(kind: Effect) -> bool:
    return shows(kind, "light")


def _smooth(picture: np.ndarray) -> np.ndarray:
    import cv2

    return cv2.GaussianBlur(picture, (0, 0), 2.0)


def _gains(picture: np.ndarray, shot: Shot) -> np.ndarray:
    """Return gains (3,) in octaves over the prediction: green, and red and blue relative to green.

    Each is a median over the parts of the room.
    """
    light, predicted = TO_LINEAR[picture], TO_LINEAR[shot.rendering.rgb]
    clear = shot.fixed & (picture.max(-1) < 252) & (predicted.min(-1) > 1e-3)
    out = []
    for part in np.unique(shot.rendering.parts[clear]):
        rows = clear & (shot.rendering.parts == part)
        if rows.sum() >= FEW:
            octaves = np.median(np.log2(np.maximum(light[rows], 1e-4)) - np.log2(predicted[rows]), 0)
            out.append([octaves[1], octaves[0] - octaves[1], octaves[2] - octaves[1]])
    return np.median(out, 0) if out else np.full(3, np.nan)


def _at_rest(world: World) -> World:
    """Return the world without motion blur, which is added by each border's speed."""
    effects = (e.with_values(exposure=0.0) if e.effect == MOTION else e for e in world.effects)
    return replace(world, effects=tuple(effects))


def _softness(picture: np.ndarray, shot: Shot, seconds: float) -> np.ndarray:
    """Return (2,): spread of most borders, px^2, and its growth with squared speed across the border, ms^2.

    An exposure of `seconds` adds the variance of a box to the spread of a moving border. The growth is estimated from
    borders of bodies that move in the picture. Those of a hand that carries the camera never move, and their surfaces
    look softer or harder for other reasons.
    """
    square = softness(picture, shot.borders, search(picture, shot.borders, WINDOW)) ** 2
    square = square + (seconds * shot.flow) ** 2 / 12
    good = np.isfinite(square)
    if good.sum() < EDGES:
        return np.full(2, np.nan)
    return np.array([float(np.median(square[good])), _growth(square, shot, good)])


def _growth(square: np.ndarray, shot: Shot, good: np.ndarray) -> float:
    """Return the growth of spreads (n,) px^2 with squared speed, ms^2; NaN if too few borders move."""
    speed = (shot.flow / 1e3) ** 2  # (px/ms)^2
    rows = good & np.isin(shot.borders.body, shot.borders.body[speed > (STILL / 1e3) ** 2])
    if rows.sum() < EDGES:
        return np.nan
    slow = rows & (speed <= np.quantile(speed[rows], 0.33))
    fast = rows & (speed >= np.quantile(speed[rows], 0.67))
    apart = float(np.median(speed[fast]) - np.median(speed[slow]))
    return float(np.median(square[fast]) - np.median(square[slow])) / apart if apart > (FAST / 1e3) ** 2 else np.nan


def _grain(picture: np.ndarray, shot: Shot) -> np.ndarray:
    """Return the log of the noise in code values in the quietest places, (levels,) by brightness."""
    import cv2

    mask = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32) / 6
    green = picture[..., 1].astype(np.float32)
    local = np.sqrt(np.maximum(cv2.boxFilter(cv2.filter2D(green, -1, mask) ** 2, -1, (7, 7)), 0))
    bins = np.digitize(cv2.boxFilter(green, -1, (7, 7)), LEVELS)
    inside = depth_residual(shot.rendering.depth, shot.rendering).interior
    out = []
    for k in range(1, len(LEVELS)):
        rows = local[inside & (bins == k)]
        out.append(float(np.log(np.hypot(np.quantile(rows, QUIET), GRAIN))) if len(rows) >= 10 * FEW else np.nan)
    return np.array(out)
