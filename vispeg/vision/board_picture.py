"""Draw a calibration board into rendered pictures of a cell, by casting rays onto it; nearer things hide it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from vispeg.core.seeds import stream
from vispeg.render.calibration.board import Board
from vispeg.robots.scene import Scene
from vispeg.vision.eye import Eye
from vispeg.vision.predict import TO_LINEAR, Rendering, encoded

FINER = 3  # rays per pixel in each direction; odd, so that one goes through the middle
PER_SQUARE = 24  # texels per side of a square
LIGHT = 0.8  # linear brightness of the board's white
LIFT = 2e-3  # m; a board at most this far behind the depth in the picture is still visible
THICK, GAP = 3e-3, 0.01  # m, thickness of the board; gap between its printed side and the fixture
LAID_M, LAID_RAD = 0.01, 0.1  # largest random shift per axis, m, and turn, rad, of a board put down by hand


def put_down(board: Board, scene: Scene, seed: int) -> np.ndarray:
    """Return a random pose (4, 4), board to base, z into the board, flat on the table beside the fixture."""
    rng = stream(seed, "board")
    x, y, _ = scene.target
    columns, rows = board.grid
    middle = 0.5 * board.square * np.array([columns - 1, rows - 1])
    out = np.eye(4)
    away = scene.config.block + GAP + LAID_M + 0.5 * board.square * (rows + 1)
    turned = Rotation.from_euler("z", np.pi / 2 + rng.uniform(-LAID_RAD, LAID_RAD))
    out[:3, :3] = turned.as_matrix() @ np.diag([1.0, -1.0, -1.0])
    centre = np.array([x - away, y, THICK]) + [*rng.uniform(-LAID_M, LAID_M, 2), 0.0]
    out[:3, 3] = centre - out[:3, :2] @ middle
    return out


def showing(board: Board, pose: np.ndarray) -> Callable[[Rendering], Rendering]:
    """Return a function that draws a board at a pose (4, 4), board to base, into a rendered picture."""

    def shown(picture: Rendering) -> Rendering:
        camera = picture.pose[:3, 3], picture.pose[:3, :3]
        rgb, depth = with_board(picture.rgb, picture.depth, picture.eye, camera, board, pose)
        return replace(picture, rgb=rgb, depth=depth)

    return shown


def texture(board: Board) -> np.ndarray:
    """Return brightness (rows, columns) in [0, 1] per texel, up to one square beyond the outermost corners."""
    columns, rows = board.grid
    if board.kind == "charuco":
        size = (board.columns * PER_SQUARE, board.rows * PER_SQUARE)
        return board.opencv().generateImage(size, marginSize=0).astype(float) / 255
    y, x = np.mgrid[: rows + 1, : columns + 1]
    return np.kron((x + y) % 2 == 1, np.ones((PER_SQUARE, PER_SQUARE)))  # dark between the first four corners


def with_board(
    rgb: np.ndarray,
    depth: np.ndarray,
    eye: Eye,
    camera: tuple[np.ndarray, np.ndarray],
    board: Board,
    pose: np.ndarray,
    height: Callable[[np.ndarray, np.ndarray], np.ndarray] = lambda x, y: np.zeros_like(x),
) -> tuple[np.ndarray, np.ndarray]:
    """Return a picture and its depth with a board in it.

    Args:
        rgb, depth: (H, W, 3) uint8 and (H, W) m without the board; depth is 0 where there is no surface.
        eye: the camera.
        camera: its position (3,) m and its axes (3, 3), as columns, in the base frame.
        board: what is printed.
        pose: (4, 4) board to base, z into the board.
        height: function of board coordinates x, y, m: height of a bent board above its plane, towards the viewer, m.
    """
    fine, (pos, turn) = eye.finer(FINER), camera
    rays = fine.rays() @ turn.T @ pose[:3, :3]  # in the board's axes, planar depth 1
    start = (pos - pose[:3, 3]) @ pose[:3, :3]
    far = -start[2] / rays[..., 2]
    for _ in range(4):  # fixed-point iteration to where the ray meets a bent board
        x, y = start[0] + far * rays[..., 0], start[1] + far * rays[..., 1]
        far = (-height(x, y) - start[2]) / rays[..., 2]
    image, edge = texture(board), board.square
    columns, rows = (n * PER_SQUARE for n in (board.grid[0] + 1, board.grid[1] + 1))
    u, v = (np.nan_to_num(np.floor((w + edge) / edge * PER_SQUARE), nan=-1, posinf=-1, neginf=-1) for w in (x, y))
    u, v = np.clip(u, -1, columns).astype(int), np.clip(v, -1, rows).astype(int)
    inside = (u >= 0) & (v >= 0) & (u < columns) & (v < rows) & (far > 0)
    colour = np.where(inside, LIGHT * image[np.clip(v, 0, rows - 1), np.clip(u, 0, columns - 1)], 0.0)
    surface = np.kron(np.where(depth > 0, depth, np.inf), np.ones((FINER, FINER)))
    visible = inside & (far < surface + LIFT)
    h, w = depth.shape

    def mean(values: np.ndarray) -> np.ndarray:
        return values.reshape(h, FINER, w, FINER).mean(axis=(1, 3))

    share = mean(visible)[..., None]
    light = TO_LINEAR[rgb] * (1 - share) + mean(np.where(visible, colour, 0.0))[..., None]
    middle = slice(FINER // 2, None, FINER)
    nearer = np.where(visible, far, 0.0)[middle, middle]
    return encoded(light), np.where(nearer > 0, nearer, depth).astype(np.float32)
