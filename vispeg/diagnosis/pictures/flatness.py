"""Flatness of the calibration board: the error that fitted corner heights explain in held-out views.

A misplacement is a corner's measured minus its predicted pixel, u and v one after the other. Each view has its own
fitted board pose, which absorbs errors of robot, mount and delay, so only the board's shape remains. A lens error
outside the library also appears as heights; the model is wrong in either case.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from vispeg.diagnosis.pictures.remainder import Left
from vispeg.identify.pictures.corners import looks_of
from vispeg.identify.pictures.robust import fit, noise_of
from vispeg.identify.pictures.sight import Sight
from vispeg.render.calibration.board import Board
from vispeg.vision.board import LEAST, Look, pose_of_board
from vispeg.vision.eye import Eye
from vispeg.vision.geometry import Geometry
from vispeg.worlds.world import World

SMALL = 1e-4  # m, rad: steps of derivatives
ROUNDS = 3  # of the pose fit and of the robust weights
PLANE = 1e-6  # 1/mm^2, precision of the heights beforehand: those of a plane move no view
Heights = tuple[np.ndarray, np.ndarray]  # misplacements (n,) px, and slopes (n, corners) px per mm of corner height


def heights_left(geometry: Geometry, fitted: Sequence[Sight], judged: Sequence[Sight], world: World) -> list[Left]:
    """Return what corner heights fitted to some sights explain in others.

    Empty without a board in both, and if not all boards are the same.
    """
    first, second = (_stacked(geometry, sights, world) for sights in (fitted, judged))
    if first is None or second is None or len({s.board for s in (*fitted, *judged)} - {None}) > 1:
        return []
    return [judge_heights(*first, *second)]


def judge_heights(away: np.ndarray, slopes: np.ndarray, held_away: np.ndarray, held_slopes: np.ndarray) -> Left:
    """Fit one height per corner, mm, robustly, and return the share and the RMS px that they explain when held out.

    Args:
        away, held_away: (n,) px, misplacements to fit and to judge on, each view's pose projected out.
        slopes, held_slopes: (n, corners) px per mm of height, likewise.
    """
    noise = noise_of(away)
    scales = (3 * noise, *[noise] * ROUNDS)  # wide at first, as the heights are unknown
    heights = fit(slopes, away, scales, PLANE)
    predicted = held_slopes @ heights
    drop = float(np.sum(held_away**2 - (held_away - predicted) ** 2))
    size, share = float(np.sqrt(np.mean(predicted**2))), drop / max(float(np.sum(held_away**2)), 1e-9)
    where = f"corners up to {np.abs(heights).max():.1f} mm off a plane"
    return Left("the board's shape", max(share, 0.0), size, where)


def _stacked(geometry: Geometry, sights: Sequence[Sight], world: World) -> Heights | None:
    """Return misplacements and slopes of all sights' views, see `judge_heights`; None without any."""
    parts = []
    for sight in sights:
        looks = list(looks_of(geometry, sight, world).values())
        if sight.board is not None and (part := heights_of_views(geometry.eyes[sight.camera.name], sight.board, looks)):
            parts.append(part)
    return _concatenated(parts) if parts else None


def heights_of_views(eye: Eye, board: Board, looks: Sequence[Look]) -> Heights | None:
    """Return misplacements and slopes of all views, see `judge_heights`; None without any.

    Views with fewer than `LEAST` corners are skipped, and so are those with a corner that has no projection.
    """
    enough = [look for look in looks if len(look.view.ids) >= LEAST]
    parts = [part for look in enough if (part := _of_view(eye, board, look)) is not None]
    return _concatenated(parts) if parts else None


def _concatenated(parts: Sequence[Heights]) -> Heights:
    away, slopes = (np.concatenate(x) for x in zip(*parts, strict=True))
    return away, slopes


def _of_view(eye: Eye, board: Board, look: Look) -> Heights | None:
    """Return misplacements and slopes of one view, with what a change of the board's pose does projected out."""
    pose, ids = pose_of_board(eye, board, look), look.view.ids

    def seen(points: np.ndarray) -> np.ndarray:
        """Return the pixels (2 n,) of points (n, 3) m in the board's frame."""
        return look.project(eye, points @ pose[:3, :3].T + pose[:3, 3]).ravel()

    flat = board.points[ids]
    for _ in range(ROUNDS):  # Gauss-Newton steps of the pose
        here = seen(flat)
        steps = [SMALL * axis for axis in np.eye(6)]
        turned = [flat @ Rotation.from_rotvec(s[3:]).as_matrix().T + s[:3] for s in steps]
        jacobian = np.stack([seen(t) - here for t in turned], axis=1) / SMALL
        away = look.view.pixels.ravel() - here
        if not np.isfinite(away).all():
            return None
        x = np.linalg.lstsq(jacobian, away, rcond=None)[0]
        turn = np.eye(4)
        turn[:3, :3], turn[:3, 3] = Rotation.from_rotvec(x[3:]).as_matrix(), x[:3]
        pose = pose @ turn
    lifted = seen(flat + [0, 0, SMALL]) - seen(flat)
    slopes = np.zeros((len(lifted), len(board.points)))
    slopes[np.arange(len(lifted)), np.repeat(ids, 2)] = lifted / SMALL / 1e3
    basis = np.linalg.qr(jacobian)[0]
    away = look.view.pixels.ravel() - seen(flat)
    return away - basis @ (basis.T @ away), slopes - basis @ (basis.T @ slopes)
