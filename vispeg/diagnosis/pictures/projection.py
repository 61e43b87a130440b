"""A camera's error as the shift of points at a working distance in its image, with its uncertainty.

Focal length and distance, or principal point and rotation, are hardly identifiable one by one, but the shift that they
cause together is. Shift and uncertainty correspond to mrcal's "projection difference" and "projection uncertainty"
(Kogan, mrcal documentation). Unlike mrcal, both cameras are compared in the robot's base frame: no transform between
them is fitted first, so an error of the camera's pose counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vispeg.core.effect import OPTICAL, effect
from vispeg.diagnosis.findings import Rivals
from vispeg.diagnosis.pictures.excited import motion_between
from vispeg.identify.fit import Fit
from vispeg.identify.pictures.evidence import BorderEvidence
from vispeg.render.cameras.camera import Camera
from vispeg.vision.geometry import Geometry
from vispeg.worlds.world import World

GRID = (12, 9)  # points across and down the image
DISTANCES = (0.15, 0.25, 0.5)  # m: the tool's tip as its camera sees it, a fixture being approached, the cell


@dataclass(frozen=True)
class Projection:
    """The shift of a grid of points in a camera's image, from one world to another.

    Attributes:
        camera: name of the camera.
        distance: of the points along its optical axis, m.
        pixels: (9, 12, 2) px, u and v of the points in the first world.
        shift: (9, 12, 2) px, change of u and v in the second world.
        sigma: (9, 12) px, standard error of the shift in the direction in which it is largest; 0 without a fit.
    """

    camera: str
    distance: float
    pixels: np.ndarray
    shift: np.ndarray
    sigma: np.ndarray

    @property
    def size(self) -> float:
        """RMS shift over the image, px."""
        return float(np.sqrt(np.nanmean(np.sum(self.shift**2, -1))))

    def as_dict(self) -> dict:
        """Return the record's entry: RMS, greatest and central shift, and RMS uncertainty, px."""
        length = np.linalg.norm(self.shift, axis=-1)
        middle = tuple(n // 2 for n in length.shape)
        return {
            "camera": self.camera,
            "distance_m": self.distance,
            "rms_px": round(self.size, 3),
            "largest_px": round(float(np.nanmax(length)), 3),
            "centre_px": [round(float(v), 3) for v in self.shift[middle]],
            "uncertainty_px": round(float(np.sqrt(np.nanmean(self.sigma**2))), 3),
        }


def projections(geometry: Geometry, before: World, after: World, fit: Fit | None) -> list[Projection]:
    """Return the shift from one world to another, for every camera and each of DISTANCES.

    Args:
        geometry: the cell with its cameras.
        before: first world.
        after: second world.
        fit: the fit that led to the second world, for the uncertainty; None for none.
    """
    out = []
    for camera in geometry.cameras:
        for distance in DISTANCES:
            shift = _shift(geometry, camera, before, after, distance)
            sigma = np.zeros(shift.shape[:2]) if fit is None else _sigma(geometry, camera, before, fit, distance)
            out.append(Projection(camera.name, distance, _pixels(camera), shift, sigma))
    return out


def confounded(judged: BorderEvidence, world: World, rivals: Sequence[Rivals]) -> list[dict]:
    """Return how much the images of an effect and of a confounded one differ, and what would distinguish them.

    Args:
        judged: borders in the held-out pictures, which did not distinguish the two.
        world: the fitted model, with all named effects.
        rivals: for some of these effects, the effects confounded with it.

    Returns:
        One row per pair: `effect` and `rival` (labels), `views_px` (RMS shift of the held-out borders between `world`
        and the world with the rival instead), `motion` (one that would distinguish the two), and `projection` (entries
        of `Projection.as_dict`; empty unless both effects are of cameras or looks, as an arm's error shifts the image
        differently in each posture).
    """
    out = []
    for r in rivals:
        for t in r.equals:
            names = r.label.split("(")[0], t.score.placed.effect
            optical = all(effect(name).family in OPTICAL for name in names)
            maps = projections(judged.geometry, world, t.fit.world, None) if optical else []
            row = {"effect": r.label, "rival": t.score.label, "views_px": round(judged.change(world, t.fit.world), 3)}
            row |= {"projection": [m.as_dict() for m in maps], "motion": motion_between(names[0], names[1:])}
            out.append(row)
    return out


def _pixels(camera: Camera) -> np.ndarray:
    """Return a grid of pixels over a camera's image, (9, 12, 2): row, column, u and v in px."""
    u = np.linspace(0, camera.width - 1, GRID[0])
    v = np.linspace(0, camera.height - 1, GRID[1])
    return np.stack(np.meshgrid(u, v), -1)


def _shift(geometry: Geometry, camera: Camera, before: World, after: World, distance: float) -> np.ndarray:
    """Return the shift (9, 12, 2) px of the points on a grid of pixels, between two worlds.

    The points lie at `distance` m along the optical axis of the camera in `before`, fixed in the base frame.
    """
    geometry.place(before)
    was = geometry.eyes[camera.name]
    pixels = _pixels(camera)
    points = np.concatenate([was.ideal(pixels), np.ones((*pixels.shape[:2], 1))], -1) * distance
    carried = points @ was.camera.rotation.T + was.camera.pos
    geometry.place(after)
    now = geometry.eyes[camera.name]
    return now.project((carried - np.array(now.camera.pos)) @ now.camera.rotation) - pixels


def _sigma(geometry: Geometry, camera: Camera, before: World, fit: Fit, distance: float) -> np.ndarray:
    """Return the largest standard error of the shift over all directions, (9, 12) px, by the covariance of a fit."""
    covariance = fit.correlation * np.outer(fit.sigma, fit.sigma)
    fitted = _shift(geometry, camera, before, fit.space.at(fit.u), distance)
    jac = []
    for step, axis in zip(fit.space.steps(fit.u), np.eye(len(fit.u)), strict=True):
        jac.append((_shift(geometry, camera, before, fit.space.at(fit.u + step * axis), distance) - fitted) / step)
    slope = np.stack(jac, -1)  # (9, 12, 2, n), px per unit of each of the fit's n parameters
    spread = np.nan_to_num(slope @ covariance @ np.swapaxes(slope, -1, -2))
    return np.sqrt(np.maximum(np.linalg.eigvalsh(spread)[..., -1], 0))
