"""The commanded motions: the peg's end moves from rest in free air through points over and in the hole."""

from __future__ import annotations

import numpy as np
from contact_arm import turn
from contact_plant import DOWN, MOUTH, RATE, TIP

REST = 0.4  # s at the start
# seconds, x y z of the tip (mm, nominal hole's frame), roll pitch (deg, about the tip), yaw (deg)
Point = tuple[float, float, float, float, float, float, float]


def _free() -> list[Point]:
    return [(0.45, 0, 0, 35, 14, 0, 0), (0.45, 8, 5, 30, 0, 14, 0), (0.35, 0, 0, 30, 0, 0, 0), (0.2, 0, 0, 30, 0, 0, 0)]


def _press(x: float, y: float, deep: float) -> list[Point]:
    return [(0.3, x, y, 2, 0, 0, 0), (0.5, x, y, -deep, 0, 0, 0), (0.2, x, y, -deep, 0, 0, 0), (0.2, x, y, 4, 0, 0, 0)]


def _slide(deep: float, far: float) -> list[Point]:
    """Return strokes along y, then along x, beside the hole, much longer than the soft wrist gives way; in mm."""
    out: list[Point] = [(0.3, 30, 0, 2, 0, 0, 0), (0.4, 30, 0, -deep, 0, 0, 0)]
    out += [(0.5, 30, far, -deep, 0, 0, 0), (0.9, 30, -far, -deep, 0, 0, 0), (0.5, 30, 0, -deep, 0, 0, 0)]
    return [*out, (0.4, 42, 0, -deep, 0, 0, 0), (0.6, 20, 0, -deep, 0, 0, 0), (0.2, 20, 0, 4, 0, 0, 0)]


def _insert(depths: tuple[float, ...], far: tuple[float, ...], yaw: float = 0.0) -> list[Point]:
    """Return insertions to each depth, and there commands `far` beyond the wall in turn, which press on it; in mm."""
    out: list[Point] = [(0.4, 0, 0, 4, 0, 0, yaw)]
    for d, r in zip(depths, far, strict=True):
        out += [(0.4, 0, 0, -d, 0, 0, yaw)]
        out += [(0.35, x, y, -d, 0, 0, yaw) for x, y in ((r, 0), (0, r), (-r, 0), (0, -r), (r, 0), (0, 0))]
    return [*out, (0.4, 0, 0, 8, 0, 0, yaw)]


def _rock(deep: float, angle: float) -> list[Point]:
    turns = ((angle, 0), (-angle, 0), (0, angle), (0, -angle), (0, 0))
    return [(0.4, 0, 0, 4, 0, 0, 0), (0.5, 0, 0, -deep, 0, 0, 0),
            *((0.6, 0, 0, -deep, a, b, 0) for a, b in turns), (0.4, 0, 0, 8, 0, 0, 0)]  # fmt: skip


def _tap(x: float, y: float) -> list[Point]:
    out: list[Point] = [(0.3, x, y, 8, 0, 0, 0)]
    for quick in (0.3, 0.2, 0.12):
        out += [(quick, x, y, -6, 0, 0, 0), (0.12, x, y, -6, 0, 0, 0), (0.25, x, y, 8, 0, 0, 0)]
    return out


MOTIONS: dict[str, list[Point]] = {
    "free": _free(),
    "press": [*_press(30, 0, 5), *_press(-30, 0, 3), *_press(0, 30, 8), *_press(0, -30, 5)],
    "slide": [*_slide(2.5, 28), *_slide(5, 34)],
    "insert": _insert((12.0, 20.0), (14.0, 26.0)),
    "insert-turned": [(0.9, 0, 0, 12, 0, 0, 90), *_insert((14.0,), (22.0,), 90.0), (0.7, 0, 0, 12, 0, 0, 0)],
    "rock": _rock(18.0, 10.6),
    "hard-press": [
        (0.3, 32, 0, 3, 0, 0, 0),
        (0.5, 32, 0, -55, 0, 0, 0),
        (0.3, 32, 0, -55, 0, 0, 0),
        (0.4, 32, 0, 4, 0, 0, 0),
    ],
    "tap": _tap(30, 0),
    "touch-datum": [
        (0.7, 104, 0, 4, 0, 0, 0),  # so far out that the fingers stay clear of the fixture
        (0.6, 104, 0, -46, 0, 0, 0),
        (0.3, 104, 0, -55, 0, 0, 0),
        (0.2, 104, 0, -55, 0, 0, 0),
        (0.6, 104, 0, 4, 0, 0, 0),
    ],
}
# what a case records: three recordings to fit and one to judge on
SETS = {
    "press-slide": ("free", "press", "slide"),
    "insert-rock": ("free", "insert", "rock"),
    "turned-datum-tap": ("free", "insert-turned", "touch-datum", "tap", "hard-press"),
    "judge": ("free", "mix"),
}
LIMIT = {"turned-datum-tap": 150.0, "judge": 150.0}  # N; 25 elsewhere
MIX = [*_press(-25, 18, 6), *_press(25, -18, 9), *_slide(3.5, 31), *_insert((16.0,), (20.0,)), *_rock(17.0, 10.6)[:4],
       *_tap(-30, 0)[:4], *MOTIONS["hard-press"]]  # fmt: skip


def points(names: tuple[str, ...]) -> list[Point]:
    """Return the points of several motions, one after the other."""
    return [p for name in names for p in (MIX if name == "mix" else MOTIONS[name])]


def path(names: tuple[str, ...], rate: float = RATE) -> tuple[np.ndarray, np.ndarray]:
    """Return commanded flange positions (t, 3) m and rotations (t, 3, 3), base frame: minimum jerk between points.

    Source: Flash and Hogan, J. Neuroscience 5(7), 1985.
    """
    now = np.array([0.0, 0, 30, 0, 0, 0])
    parts = [np.tile(now, (round(REST * rate), 1))]
    for seconds, *goal in points(names):
        count = max(1, round(seconds * rate))
        s = np.arange(1, count + 1) / count
        share = (10 * s**3 - 15 * s**4 + 6 * s**5)[:, None]
        parts.append(now + share * (np.array(goal, float) - now))
        now = np.array(goal, float)
    every = np.concatenate(parts)
    angles = np.radians(every[:, 3:])
    zero = np.zeros(len(every))
    about = [
        turn(np.stack(v, axis=1))
        for v in ((angles[:, 0], zero, zero), (zero, angles[:, 1], zero), (zero, zero, angles[:, 2]))
    ]
    rot = about[2] @ about[1] @ about[0] @ DOWN
    tip = MOUTH + 1e-3 * every[:, :3]
    return tip - TIP * rot[:, :, 2], rot
