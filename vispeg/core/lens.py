"""Brown's lens model on normalised image coordinates, with coefficients in OpenCV's order (k1, k2, p1, p2, k3).

With x = X/Z, y = Y/Z and r2 = x^2 + y^2 (D. C. Brown, "Close-range camera calibration", 1971; OpenCV's calib3d):
    x' = x (1 + k1 r2 + k2 r2^2 + k3 r2^3) + 2 p1 x y + p2 (r2 + 2 x^2)
    y' = y (1 + k1 r2 + k2 r2^2 + k3 r2^3) + p1 (r2 + 2 y^2) + 2 p2 x y
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

STEPS = 50  # most Newton steps; 4 to 6 suffice where an inverse exists
TOLERANCE = 1e-9  # largest accepted error of x' and y', no unit


def distort(xy: np.ndarray, coefficients: Sequence[float]) -> np.ndarray:
    """Return the points (..., 2) to which the lens maps ideal points (..., 2), both in X/Z and Y/Z."""
    k1, k2, p1, p2, k3 = coefficients
    x, y = xy[..., 0], xy[..., 1]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return np.stack(
        [x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y], -1
    )


def undistort(xy: np.ndarray, coefficients: Sequence[float]) -> np.ndarray:
    """Return the ideal points (..., 2) that the lens maps to `xy` (..., 2); NaN where there is none.

    Newton's method starts at `xy`. Points where the lens folds back are not solutions, because two directions would
    share a pixel: the determinant of the Jacobian is not positive there, or x' falls with x.
    """
    target, ideal = np.asarray(xy, float), np.array(xy, float)
    if not ideal.size or not np.any(coefficients):
        return ideal
    with np.errstate(all="ignore"):
        for _ in range(STEPS):
            error = distort(ideal, coefficients) - target
            (a, b), (c, d) = _jacobian(ideal, coefficients)
            det = a * d - b * c
            step = np.stack([d * error[..., 0] - b * error[..., 1], a * error[..., 1] - c * error[..., 0]], -1)
            ideal -= step / det[..., None]
            if not (np.abs(error) > TOLERANCE * 1e-3).any():  # False for NaN, of points that diverged
                break
        (a, b), (c, d) = _jacobian(ideal, coefficients)
        error = np.abs(distort(ideal, coefficients) - target).max(-1)
        wrong = ~(error < TOLERANCE) | ~(a * d - b * c > 0) | ~(a > 0)  # negated comparisons also catch NaN
    ideal[wrong] = np.nan
    return ideal


def _jacobian(xy: np.ndarray, coefficients: Sequence[float]) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
    """Return ((dx'/dx, dx'/dy), (dy'/dx, dy'/dy)) at points (..., 2), each (...)."""
    k1, k2, p1, p2, k3 = coefficients
    x, y = xy[..., 0], xy[..., 1]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2 * (k1 + r2 * (2 * k2 + 3 * r2 * k3))  # d radial / dx = slope x
    cross = x * y * slope + 2 * p1 * x + 2 * p2 * y
    along_x = radial + x * x * slope + 2 * p1 * y + 6 * p2 * x
    along_y = radial + y * y * slope + 6 * p1 * y + 2 * p2 * x
    return (along_x, cross), (cross, along_y)
