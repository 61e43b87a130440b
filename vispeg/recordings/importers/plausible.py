"""Whether stated units can be true: the rate, the joints' ranges and speeds, and speeds against angles."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from vispeg.core.errors import UserError
from vispeg.recordings.checks.quality import Limited, Limits
from vispeg.recordings.checks.timing import within_episode
from vispeg.recordings.importers.mapping import FACTORS, ColumnMap
from vispeg.recordings.recording import Recording

RATES = (3.0, 20_000.0)  # Hz: slower tells nothing of dynamics, faster is no arm's log
TOP_SPEED = 40.0  # rad/s: of a joint whose limit is not known
SLOW = 2e-3  # of the speed limit (or TOP_SPEED / 10): a joint that never moves faster, though it moves far
FAR = 0.1  # rad
SMALL = 3.5  # degrees: an arm whose every angle stays below was more likely read in radians
CHUNKS, CHUNK = 20, 10_000  # stretches of a long recording that are looked at, and their rows
RADIANS = math.pi / 180


@dataclass(frozen=True)
class Doubt:
    """What cannot be true of a recording: the sentence, and the unit that would make it true."""

    key: str
    said: str
    likely: str


def slope(x: np.ndarray, y: np.ndarray, least: float = 0.7) -> float | None:
    """Slope of y over x by least squares over all columns; None where they do not go together, or hardly move."""
    good = np.isfinite(x) & np.isfinite(y)
    a, b = x[good] - x[good].mean() if good.any() else x[good], y[good] - y[good].mean() if good.any() else y[good]
    if len(a) < 10 or not (a @ a > 0 and b @ b > 0):
        return None
    together = float(a @ b) / math.sqrt(float(a @ a) * float(b @ b))
    return float(a @ b) / float(a @ a) if together > least else None


def doubts(rec: Recording, limits: Limits, degrees: bool = False) -> list[Doubt]:
    """What the units of a recording make impossible, the surest first; empty where all can be.

    Args:
        rec: the recording, in what is said to be SI units.
        limits: the robot's, in the order of its joints; infinite where not known.
        degrees: whether the angles were said to be in degrees before they became radians.
    """
    rec, inside = _some(rec)
    step = np.diff(rec.time)
    period = float(np.median(step[inside])) if inside.any() else 1.0 / rec.rate_hz
    rate = 1.0 / period
    speed = np.diff(rec.q, axis=0)[inside] / step[inside][:, None]
    top = np.where(np.isfinite(limits.velocity), limits.velocity, TOP_SPEED / 10)
    fast = np.nanquantile(np.abs(speed), 0.99, axis=0) / top if len(speed) else np.zeros(len(top))
    candidates = [_rate(rate), _against_speeds(rec, speed, inside), _degrees(rec, limits, degrees)]
    candidates += [_speeds(rate, fast, rec), _torque(rec, limits)]
    return [doubt for doubt in candidates if doubt is not None]


def _some(rec: Recording) -> tuple[Recording, np.ndarray]:
    """As much of a long recording as units can be judged by, and which of its steps (n - 1,) are real ones."""
    n, inside = len(rec.time), within_episode(rec)
    if n <= CHUNKS * CHUNK:
        return rec, inside
    starts = np.linspace(0, n - CHUNK, CHUNKS).astype(int)
    rows = np.concatenate([np.arange(start, start + CHUNK) for start in starts])
    cut = {name: value[rows] for name in ("time", "q", "dq", "tau") if (value := getattr(rec, name)) is not None}
    return replace(rec, **cut), (np.diff(rows) == 1) & inside[np.minimum(rows[:-1], n - 2)]


def _rate(rate: float) -> Doubt | None:
    if RATES[0] <= rate <= RATES[1]:
        return None
    said = f"{rate:.4g} samples a second"
    if rate < RATES[0]:
        likely = next((u for u, f in (("ms", 1e3), ("us", 1e6), ("ns", 1e9)) if RATES[0] <= rate * f <= RATES[1]), "")
        return Doubt("time", f"{said}: too few for a motion", f"{likely} where s was taken" if likely else "")
    likely = next((u for u, f in (("ms", 1e3), ("us", 1e6), ("ns", 1e9)) if RATES[0] <= rate / f <= RATES[1]), "")
    return Doubt("time", f"{said}: more than any arm logs", f"s where {likely} was taken" if likely else "")


def _against_speeds(rec: Recording, speed: np.ndarray, inside: np.ndarray) -> Doubt | None:
    """Measured speeds are the slope of measured angles, or one of the three units is wrong."""
    if rec.dq is None:
        return None
    ratio = slope(speed, rec.dq[1:][inside])
    if ratio is None or 0.5 < ratio < 2.0:
        return None
    said = f"measured speeds are {ratio:.3g} times the change of the angles"
    for factor, likely in (
        (1 / RADIANS, "deg/s for dq, or rad for q"),
        (RADIANS, "deg for q, or rad/s for dq"),
        (1e3, "ms for the time"),
        (1e-3, "s for the time"),
        (9.5493, "rpm for dq"),
    ):
        if 0.8 < ratio / factor < 1.25:
            return Doubt("time, q, dq", said, likely)
    return Doubt("time, q, dq", said, "")


def _degrees(rec: Recording, limits: Limits, stated: bool) -> Doubt | None:
    low, high = limits.range.T
    beyond = float(np.mean((rec.q < low - FAR) | (rec.q > high + FAR)))
    fits = not np.any((rec.q * RADIANS < low) | (rec.q * RADIANS > high))
    if beyond > 0.02 and fits:
        return Doubt("q", f"{beyond:.0%} of the angles are outside the joints' ranges", "deg")
    peak = float(np.nanmax(np.abs(rec.q)))
    if stated and 1e-3 < peak < SMALL * RADIANS:
        return Doubt("q", f"no angle is larger than {peak / RADIANS:.2g} degrees", "rad, not deg")
    return None


def _speeds(rate: float, fast: np.ndarray, rec: Recording) -> Doubt | None:
    if not len(fast):
        return None
    if np.max(fast) > 5.0:
        said = f"the joints are up to {float(np.max(fast)):.3g} times as fast as they can be"
        degrees = np.max(fast) * RADIANS < 1.5 and float(np.nanmax(np.abs(rec.q))) > 0.5
        return Doubt("time, q", said, "a longer unit of time" + (", or deg for q" if degrees else ""))
    far = float(np.nanmax(np.nanmax(rec.q, axis=0) - np.nanmin(rec.q, axis=0)))
    if np.max(fast) < SLOW and far > FAR and rate < 50.0:
        said = f"the joints move {far:.2g} rad, yet never faster than {float(np.max(fast)):.1g} of what they can"
        return Doubt("time", said, "a shorter unit of time, such as ms for s")
    return None


def _torque(rec: Recording, limits: Limits) -> Doubt | None:
    if rec.tau is None:
        return None
    peak = np.nanquantile(np.abs(rec.tau), 0.99, axis=0) / np.where(limits.torque > 0, limits.torque, np.inf)
    if np.max(peak) > 20.0:
        said = f"torques are up to {float(np.max(peak)):.3g} times the joints' limits"
        return Doubt("tau", said, "mNm")
    return None


def refuse_units(rec: Recording, robot: Limited, mapping: ColumnMap, file: Path, stated: str) -> None:
    """Raises UserError where units cannot be true, with the likely ones; a joint that is not the robot's tells nothing.

    Args:
        rec: what the units made of a log.
        robot: whose limits say what can be true.
        mapping: with the units.
        file: that the error names.
        stated: where the units should be put right, such as `the map`.
    """
    if not set(rec.joints) <= set(robot.joints):
        return
    angles = [origin for target, origin in mapping.columns.items() if target.partition(".")[0] == "q"]
    said = doubts(rec, Limits.of(robot, rec.joints), any(abs(origin.factor) == FACTORS["deg"] for origin in angles))
    if not said:
        return
    likely = list(dict.fromkeys(doubt.likely for doubt in said if doubt.likely))
    unit = f" (likely {' or '.join(likely)})" if likely else ""
    expected = f"the right unit in {stated}{unit}, or --insist"
    raise UserError(f"a unit cannot be true: {said[0].said}", file=file, key=said[0].key, expected=expected)
