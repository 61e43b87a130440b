"""Check whether stated units are plausible, from the sample rate, joint ranges, speeds, torques and their relations."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from vispeg.core.errors import UserError
from vispeg.recordings.checks.quality import Limited, Limits
from vispeg.recordings.checks.timing import within_episode
from vispeg.recordings.differentiate import smooth
from vispeg.recordings.importers.fits import Needs
from vispeg.recordings.importers.mapping import ColumnMap
from vispeg.recordings.importers.slopes import Doubt, against_speeds, slope
from vispeg.recordings.recording import Recording

RATES = (3.0, 20_000.0)  # Hz, plausible sample rates: slower shows no dynamics, and no arm logs faster
TOP_SPEED = 40.0  # rad/s: no joint is faster; a tenth of it is the assumed limit of a joint without a stated one
SLOW = 2e-3  # share of the speed limit: implausibly slow for a joint that moves by FAR
FAR = 0.1  # rad: motion by which a joint counts as moved, and tolerance at the ends of its range
SMALL = 3.5  # degrees: if every angle stays below this, the values are more likely radians
CHUNKS, CHUNK = 20, 10_000  # number of stretches of a long recording that are checked, and rows of each
FAR_BEYOND = 10.0  # multiple of a joint's torque limit that no real torque reaches
MOTION_HZ, POSTURES = 8.0, 1000  # bandwidth of the smoothed motion, and samples at which the model's torque is computed
CARRIED = 0.8  # least correlation of measured and modelled torques for their scale to be meaningful
RADIANS = math.pi / 180  # per degree


def doubts(rec: Recording, limits: Limits, degrees: bool = False, needs: Needs | None = None) -> list[Doubt]:
    """List what is implausible about a recording's units, the most certain first; empty if all are plausible.

    Args:
        rec: the recording, converted to SI units with the stated units.
        limits: the robot's limits, in the order of its joints; infinite where not known.
        degrees: whether the angles were said to be in degrees before they became radians.
        needs: torques of the robot's model for a motion of the recording's joints; None where that is not known.
    """
    rec, inside = _excerpt(rec)
    step = np.diff(rec.time)
    period = float(np.median(step[inside])) if inside.any() else 1.0 / rec.rate_hz
    rate = 1.0 / period
    speed = np.diff(rec.q, axis=0)[inside] / step[inside][:, None]
    top = np.where(np.isfinite(limits.velocity), limits.velocity, TOP_SPEED / 10)
    fast = np.nanquantile(np.abs(speed), 0.99, axis=0) / top if len(speed) else np.zeros(len(top))
    if (impossible := _rate(rate)) is not None:  # with such a clock, filters would need billions of samples
        return [impossible]
    candidates = [*against_speeds(rec, inside, period), _against_commands(rec)]
    candidates += [_degrees(rec, limits, degrees, fast), _speeds(rate, fast, rec), _torque(rec, limits, needs)]
    return sorted((doubt for doubt in candidates if doubt is not None), key=lambda doubt: not doubt.sure)


def _excerpt(rec: Recording) -> tuple[Recording, np.ndarray]:
    """Take stretches of a long recording that suffice to check units; mark which row steps (n - 1,) lie inside one."""
    n, inside = len(rec.time), within_episode(rec)
    if n <= CHUNKS * CHUNK:
        return rec, inside
    starts = np.linspace(0, n - CHUNK, CHUNKS).astype(int)
    rows = np.concatenate([np.arange(start, start + CHUNK) for start in starts])
    names = ("time", "episode", "q", "dq", "tau", "q_cmd")
    cut = {name: value[rows] for name in names if (value := getattr(rec, name)) is not None}
    return replace(rec, **cut), (np.diff(rows) == 1) & inside[np.minimum(rows[:-1], n - 2)]


def _rate(rate: float) -> Doubt | None:
    """Return a doubt about a sample rate, Hz, outside `RATES`."""
    if RATES[0] <= rate <= RATES[1]:
        return None
    said, per_second = f"{rate:.4g} samples a second", (("ms", 1e3), ("us", 1e6), ("ns", 1e9))
    if rate < RATES[0]:
        likely = next((unit for unit, count in per_second if RATES[0] <= rate * count <= RATES[1]), "")
        return Doubt("time", f"{said}: too few for a motion", f"{likely} where s was taken" if likely else "")
    likely = next((unit for unit, count in per_second if RATES[0] <= rate / count <= RATES[1]), "")
    return Doubt("time", f"{said}: more than any arm logs", f"s where {likely} was taken" if likely else "")


def _against_commands(rec: Recording) -> Doubt | None:
    """Compare measured with commanded angles: if they follow at another scale, one of them is in another unit."""
    ratio = None if rec.q_cmd is None else slope(rec.q_cmd, rec.q, 0.9)
    if ratio is None:
        return None
    said = f"measured angles are {ratio:.3g} times the commanded ones"
    if 0.8 < ratio * RADIANS < 1.25:
        return Doubt("q, q_cmd", said, "deg for q, or rad for q_cmd", True)
    if 0.8 < ratio / RADIANS < 1.25:
        return Doubt("q, q_cmd", said, "rad for q, or deg for q_cmd", True)
    return None


def _degrees(rec: Recording, limits: Limits, stated: bool, fast: np.ndarray) -> Doubt | None:
    """Return a doubt about angles that look like degrees, or like radians although they were `stated` to be degrees.

    `fast` (nj,) is the joints' speed over their limit.
    """
    low, high = limits.range.T
    beyond = float(np.mean((rec.q < low - FAR) | (rec.q > high + FAR)))
    fits = not np.any((rec.q * RADIANS < low) | (rec.q * RADIANS > high))
    if beyond > 0.02 and fits:
        # angles that only wrap have possible speeds
        sure = bool(np.max(fast) > 5.0 and np.max(fast) * RADIANS < 1.5)
        column = f"q.{rec.joints[int(np.argmax(np.mean((rec.q < low - FAR) | (rec.q > high + FAR), axis=0)))]}"
        return Doubt(column, f"{beyond:.0%} of the angles are outside the joints' ranges", "deg", sure)
    peak = float(np.nanmax(np.abs(rec.q)))
    if stated and 1e-3 < peak < SMALL * RADIANS:
        return Doubt("q", f"no angle is larger than {peak / RADIANS:.2g} degrees", "rad, not deg")
    return None


def _speeds(rate: float, fast: np.ndarray, rec: Recording) -> Doubt | None:
    """Return a doubt about joints that are impossibly fast or slow; `rate` in Hz, `fast` as for `_degrees`."""
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


def _torque(rec: Recording, limits: Limits, needs: Needs | None) -> Doubt | None:
    """Compare torques with the joints' limits, and with the model's torques for the measured motion: a payload or
    friction that the model lacks changes them, but not a thousandfold.
    """
    if rec.tau is None or np.isnan(rec.tau).all(axis=0).any():
        return None
    share = np.nanquantile(np.abs(rec.tau), 0.99, axis=0) / np.where(limits.torque > 0, limits.torque, np.inf)
    times = None if needs is None else _times_needed(rec, rec.tau, needs)
    if times is not None and 0.2 < times < 5.0:
        return None  # torques match the model, so an exceeded limit is a placeholder in the robot's file
    within = bool(np.isfinite(limits.torque).all() and np.max(share) <= 1.0)
    if times is not None and 300 < times < 3000 and not within:
        said = f"torques are {times:.4g} times what the model needs for the measured motion"
        return Doubt("tau.*", said, "mNm or N mm", True)
    if np.max(share) > FAR_BEYOND:
        column, most = f"tau.{rec.joints[int(np.argmax(share))]}", float(np.max(share))
        return Doubt(column, f"torques are up to {most:.3g} times the joints' limits", "mNm")
    if times is not None and 300 < 1 / times < 3000:
        return Doubt("tau.*", f"torques are {times:.2g} times what the model needs for the measured motion", "kNm")
    return None


def _times_needed(rec: Recording, tau: np.ndarray, needs: Needs) -> float | None:
    """Return the slope of torques (n, nj) over the model's torques; None if they are hardly correlated."""
    motion = smooth(rec.time, rec.q, MOTION_HZ, rec.episode)
    rows = np.flatnonzero(np.isfinite([*motion, tau]).all(axis=(0, 2)))
    rows = rows[:: max(1, len(rows) // POSTURES)]
    if len(rows) < 10:
        return None
    needed, read = needs(*(part[rows] for part in motion)).ravel(), tau[rows].ravel()
    if not (needed @ needed > 0 and read @ read > 0):
        return None
    together = float(needed @ read) / math.sqrt(float(needed @ needed) * float(read @ read))
    return float(needed @ read) / float(needed @ needed) if together > CARRIED else None


def refuse_units(
    rec: Recording, robot: Limited, mapping: ColumnMap, file: Path, stated: str, needs: Needs | None
) -> None:
    """Raise UserError if units cannot be true, and name the likely ones; joints that the robot lacks are not checked.

    Args:
        rec: a log, converted with the stated units.
        robot: the robot, whose limits bound what is plausible.
        mapping: the map that states the units.
        file: the file that the error names.
        stated: where the user can correct the units: `the map`, or `the bag`, for which a map states none.
        needs: torques of the robot's model, as in `doubts`.
    """
    if not set(rec.joints) <= set(robot.joints):
        return
    found = [d for d in doubts(rec, Limits.of(robot, rec.joints), mapping.in_degrees, needs) if not d.scale]
    if not found:
        return
    likely = list(dict.fromkeys(doubt.likely for doubt in found if doubt.likely))
    unit = f" (likely {' or '.join(likely)})" if likely else ""
    signals = [column.partition(".")[0] for column in found[0].key.split(", ")]
    motors = ", motors: in a map if angles are the motors'" if "q" in signals else ""
    expected = f"the right unit in {stated}{unit}{motors}, or --insist"
    raise UserError(f"a unit cannot be true: {found[0].said}", file=file, key=found[0].key, expected=expected)
