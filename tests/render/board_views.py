"""A known camera before a known board: the corners as the pinhole equation has them, and pictures of the board."""

import numpy as np
from scipy.spatial.transform import Rotation

from vispeg.render.calibration import Board, Intrinsics, View

SIZE = (640, 480)
LENS = Intrinsics(SIZE, (600.0, 602.0), (322.0, 243.0), (0.05, -0.1, 0.001, -0.0005, 0.0))
BOARD = Board("chessboard", 9, 6, 0.0236)
CHARUCO = Board("charuco", 8, 6, 0.025, 0.018, "DICT_4X4_50")


def pose(degrees, metres):
    out = np.eye(4)
    out[:3, :3] = Rotation.from_euler("xyz", degrees, degrees=True).as_matrix()
    out[:3, 3] = metres
    return out


X = pose([2, -3, 91], [0.058, -0.034, -0.042])  # the camera on its mount
Z = pose([8, -12, 20], [0.5, 0.05, 0.02])  # the board on the other end


def project(lens, points):
    """Pixels (n, 2) of points (n, 3): the pinhole and Brown's five terms, written out."""
    x, y = (points[:, :2] / points[:, 2:]).T
    k1, k2, p1, p2, k3 = lens.distortion
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return np.stack([u, v], axis=1) * lens.focal + lens.centre


def place(rng, board=BOARD, tilt=35.0):
    """camera_T_board with the whole board in the image."""
    middle = board.points.mean(axis=0)
    while True:
        out = pose(rng.uniform(-tilt, tilt, 3) * [1, 1, 2], np.zeros(3))
        at = rng.uniform([-0.05, -0.04, 0.28], [0.05, 0.04, 0.42])
        out[:3, 3] = at - out[:3, :3] @ middle
        pixels = project(LENS, board.points @ out[:3, :3].T + out[:3, 3])
        if (pixels > 3).all() and (pixels < np.array(SIZE) - 4).all():
            return out


def seen(rng, count, board=BOARD, noise=0.3, tilt=35.0):
    """Views with pixel noise (px, standard deviation), and camera_T_board of each (n, 4, 4)."""
    poses = [place(rng, board, tilt) for _ in range(count)]
    views = []
    for number, at in enumerate(poses):
        pixels = project(LENS, board.points @ at[:3, :3].T + at[:3, 3])
        pixels = pixels + noise * rng.standard_normal(pixels.shape)
        views.append(View(f"{number}.png", SIZE, np.arange(len(pixels)), pixels))
    return views, np.stack(poses)


def flange(poses, mount="flange", rng=None, robot=(0.0, 0.0)):
    """base_T_flange (n, 4, 4) that make these camera_T_board, with the robot's errors (m, rad, an axis)."""
    inverse = np.linalg.inv
    out = np.stack([Z @ inverse(at) @ inverse(X) if mount == "flange" else X @ at @ inverse(Z) for at in poses])
    if rng is not None:
        out[:, :3, 3] += robot[0] * rng.standard_normal((len(out), 3))
        out[:, :3, :3] @= Rotation.from_rotvec(robot[1] * rng.standard_normal((len(out), 3))).as_matrix()
    return out


def picture(board, at, supersample=3):
    """The board at camera_T_board `at` as an ideal lens without distortion sees it, uint8 (height, width)."""
    import cv2

    squares = np.array(board.grid) + 1
    dots = 60  # of the texture a square
    if board.kind == "charuco":
        sheet = board.opencv().generateImage(tuple(int(n) * dots for n in squares), marginSize=0)
    else:
        odd = np.indices(squares[::-1]).sum(axis=0) % 2  # dark follows the first inner corner: (1, 1), even
        sheet = np.kron(np.where(odd == 1, 230, 30), np.ones((dots, dots))).astype(np.uint8)
    sheet = cv2.copyMakeBorder(sheet, dots, dots, dots, dots, cv2.BORDER_CONSTANT, value=255)
    # sheet pixel -> board metres: the texture's edge of the first inner corner lies at (2 dots - 1/2)
    scale = board.square / dots
    to_board = np.array([[scale, 0, (0.5 - 2 * dots) * scale], [0, scale, (0.5 - 2 * dots) * scale], [0, 0, 1]])
    to_image = LENS.matrix @ np.column_stack([at[:3, 0], at[:3, 1], at[:3, 3]]) @ to_board
    s = supersample
    enlarge = np.array([[s, 0, (s - 1) / 2], [0, s, (s - 1) / 2], [0, 0, 1.0]])
    size = (SIZE[0] * s, SIZE[1] * s)
    large = cv2.warpPerspective(sheet, enlarge @ to_image, size, flags=cv2.INTER_AREA, borderValue=150)
    return cv2.resize(large, SIZE, interpolation=cv2.INTER_AREA)


def ideal(board, at):
    """Where `picture` has the inner corners, px (n, 2)."""
    points = board.points @ at[:3, :3].T + at[:3, 3]
    return points[:, :2] / points[:, 2:] * LENS.focal + LENS.centre
