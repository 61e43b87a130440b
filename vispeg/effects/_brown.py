"""Brown's lens distortion of normalised image points, and its inverse.

x' = x (1 + k1 r^2 + k2 r^4) + 2 p1 x y + p2 (r^2 + 2 x^2), y' likewise with p1 and p2 exchanged.
Source: Brown, Decentering distortion of lenses, 1966; OpenCV, Camera calibration and 3D reconstruction.
"""

from __future__ import annotations

import numpy as np


def distort(x: np.ndarray, y: np.ndarray, k1: float, k2: float, p1: float, p2: float) -> tuple[np.ndarray, np.ndarray]:
    """Where the lens shows the points (x, y), both of any one shape, at unit distance."""
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * k2)
    xy = 2 * x * y
    return x * radial + p1 * xy + p2 * (r2 + 2 * x * x), y * radial + p2 * xy + p1 * (r2 + 2 * y * y)


def undistort(
    x: np.ndarray, y: np.ndarray, k1: float, k2: float, p1: float, p2: float, steps: int = 12
) -> tuple[np.ndarray, np.ndarray]:
    """The points that the lens shows at (x, y), by Newton's method on both coordinates.

    Beyond the radius at which a barrel distortion folds back there is none; such points come out finite and far away.
    """
    u, v = x.copy(), y.copy()
    for _ in range(steps):
        du, dv = distort(u, v, k1, k2, p1, p2)
        r2 = u * u + v * v
        radial, slope = 1 + r2 * (k1 + r2 * k2), 2 * (k1 + 2 * r2 * k2)
        a = radial + slope * u * u + 2 * p1 * v + 6 * p2 * u
        b = slope * u * v + 2 * p1 * u + 2 * p2 * v
        d = radial + slope * v * v + 2 * p2 * u + 6 * p1 * v
        det = np.maximum(a * d - b * b, 0.05)  # the symmetric Jacobian's determinant; small where the map folds
        ex, ey = x - du, y - dv
        u, v = np.clip(u + (d * ex - b * ey) / det, -10, 10), np.clip(v + (a * ey - b * ex) / det, -10, 10)
    return u, v
