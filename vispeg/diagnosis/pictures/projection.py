"""A camera error seen in an image: the shift of every pixel at a working distance, with its uncertainty.

Focal length and distance, or principal point and rotation, are hardly identifiable one by one, but their combined
shift of the picture is. So the shift is reported (mrcal's "projection difference" and "projection uncertainty";
Kogan, mrcal
documentation, "differencing" and "uncertainty"). The robot is the datum: no implied transform is taken out.
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
    """One camera at one distance.

    Attributes:
        camera, distance: name, m along the optical axis.
        pixels: (rows, columns, 2) px of the points by the given model.
        shift: (rows, columns, 2) px from there to their fitted positions.
        sigma: (rows, columns) px, worst standard error of any direction.
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
        """Return the record's entry: RMS, greatest and central shift, px."""
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
    """Return the shift of every camera's picture from one world to another, near and far."""
    out = []
    for camera in geometry.cameras:
        for distance in DISTANCES:
            shift = _seen(geometry, camera, before, after, distance)
            sigma = np.zeros(shift.shape[:2]) if fit is None else _sigma(geometry, camera, before, fit, distance)
            out.append(Projection(camera.name, distance, _pixels(camera), shift, sigma))
    return out


def confounded(judged: BorderEvidence, world: World, rivals: Sequence[Rivals]) -> list[dict]:
    """Return how much the images of an effect and of a confounded one differ, and what would distinguish them.

    Args:
        judged: of the views that could not tell.
        world: the model with all that was named.
        rivals: of its effects.

    Returns:
        A row a pair: `effect`, `rival`, `views_px` (RMS over the borders of these views), `motion`, and `projection` as
        of `Projection.as_dict` where both are of cameras: what an arm misreads has another picture in each posture.
    """
    out = []
    for r in rivals:
        for t in r.equals:
            names = r.label.split("(")[0], t.score.key[0]
            optical = all(effect(name).family in OPTICAL for name in names)
            maps = projections(judged.geometry, world, t.fit.world, None) if optical else []
            row = {"effect": r.label, "rival": t.score.label, "views_px": round(judged.change(world, t.fit.world), 3)}
            row |= {"projection": [m.as_dict() for m in maps], "motion": motion_between(names[0], names[1:])}
            out.append(row)
    return out


def _pixels(camera: Camera) -> np.ndarray:
    u = np.linspace(0, camera.width - 1, GRID[0])
    v = np.linspace(0, camera.height - 1, GRID[1])
    return np.stack(np.meshgrid(u, v), -1)


def _seen(geometry: Geometry, camera: Camera, before: World, after: World, distance: float) -> np.ndarray:
    """Return the shift (rows, columns, 2) px of points at a distance from the camera of `before` to that of `after`."""
    geometry.place(before)
    was = geometry.eyes[camera.name]
    pixels = _pixels(camera)
    points = np.concatenate([was.ideal(pixels), np.ones((*pixels.shape[:2], 1))], -1) * distance
    carried = points @ was.camera.rotation.T + was.camera.pos
    geometry.place(after)
    now = geometry.eyes[camera.name]
    return now.project((carried - np.array(now.camera.pos)) @ now.camera.rotation) - pixels


def _sigma(geometry: Geometry, camera: Camera, before: World, fit: Fit, distance: float) -> np.ndarray:
    """Return (rows, columns) px: root of the larger eigenvalue of the projected covariance."""
    covariance = fit.correlation * np.outer(fit.sigma, fit.sigma)
    here = _seen(geometry, camera, before, fit.space.at(fit.u), distance)
    jac = []
    for step, axis in zip(fit.space.steps(fit.u), np.eye(len(fit.u)), strict=True):
        jac.append((_seen(geometry, camera, before, fit.space.at(fit.u + step * axis), distance) - here) / step)
    slope = np.stack(jac, -1)  # (rows, columns, 2, n)
    spread = np.nan_to_num(slope @ covariance @ np.swapaxes(slope, -1, -2))
    return np.sqrt(np.maximum(np.linalg.eigvalsh(spread)[..., -1], 0))
