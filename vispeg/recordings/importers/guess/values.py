"""Guess units from the numbers, compared with the robot's limits and with each other."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from vispeg.recordings.checks.quality import Limits
from vispeg.recordings.importers.guess.names import Meaning
from vispeg.recordings.importers.guess.ticks import step_of_degrees
from vispeg.recordings.importers.mapping import FACTORS
from vispeg.recordings.importers.plausible import RATES, TOP_SPEED
from vispeg.recordings.importers.slopes import slope
from vispeg.recordings.importers.turns import straightened

TIMES = ("s", "ms", "us", "ns")
SPEEDS = ("rad/s", "deg/s")  # units tried for speeds whose names state none
STATED = {*SPEEDS, "rpm"}  # units that the name of a speed may state
EPOCH = (1.0e9, 4.0e9)  # s: from 2001 to 2096
TURNS = 4 * math.pi  # rad, two turns; larger values are not radians
DEGREES = 1000.0  # larger values are not degrees but encoder counts
TYPICAL_HZ = 300.0  # where several units of time are possible, the one with a rate nearest to this is proposed

Sure = Literal["stated", "measured", "likely"]  # by the file, from its numbers, or neither


@dataclass(frozen=True)
class Unit:
    """The unit of a column, and what it was chosen by.

    Attributes:
        name: the unit, of `importers.mapping.FACTORS`.
        why: reason for the choice, in words.
        sure: certainty, as in `propose.Line`.
        named: whether the column's name states the unit.
    """

    name: str
    why: str
    sure: Sure = "likely"
    named: bool = False


def _named(unit: str, more: str = "") -> Unit:
    return Unit(unit, f"the name says {unit}{more}", "stated", True)


def span(column: np.ndarray) -> tuple[float, float]:
    """Return the lowest and highest value; 0, 0 if there are none."""
    finite = column[np.isfinite(column)]
    return (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 0.0)


def all_integers(column: np.ndarray) -> bool:
    """Test whether all values are whole numbers."""
    return bool(np.isfinite(column).all() and (column == np.floor(column)).all())


def increases(column: np.ndarray, even: bool = False) -> bool:
    """Test whether a column increases like a clock, with few restarts; with `even`, also in nearly equal steps."""
    step = np.diff(column)
    if len(step) and not even:
        step = step[step != 0] if np.mean(step != 0) > 0.5 else step  # loggers write rows twice
    if len(step) < 2 or not np.isfinite(step).all() or np.mean(step > 0) < 0.97:
        return False
    return not even or bool(np.quantile(step, 0.95) < 1.5 * np.quantile(step, 0.05))


def units_of(
    columns: Mapping[str, list[Meaning]],
    stacks: Mapping[str, np.ndarray],
    limits: Limits,
    doubts: list[str],
    known: Mapping[str, Unit] | None,
) -> dict[str, Unit]:
    """Return signal -> unit: angles first, as other units are checked against them; `known` are kept."""
    out = dict(known or {})
    for signal in sorted(columns, key=lambda s: {"q": 0, "q_cmd": 1}.get(s, 2)):
        if signal in out:
            continue
        stated = {m.unit for m in columns[signal]} - {""}
        unit = stated.pop() if len(stated) == 1 else ""
        values = stacks[signal]
        if signal in ("q", "q_cmd"):
            out[signal] = _angle(unit, values, limits, signal, columns[signal], doubts)
        elif signal in ("tau", "tau_cmd"):
            out[signal] = _torque(unit, values, limits, doubts)
        else:
            out[signal] = _speed(unit, out["q"].name)
    if "q" in out and "q_cmd" in out:
        ratio = slope(stacks["q"], stacks["q_cmd"])
        if out["q"].name != out["q_cmd"].name and ratio is not None and 0.8 < ratio < 1.25:
            doubts.append(f"commanded angles look like {out['q_cmd'].name}, measured ones like {out['q'].name}")
    return out


def _angle(
    unit: str, values: np.ndarray, limits: Limits, signal: str, columns: list[Meaning], doubts: list[str]
) -> Unit:
    """Return the unit of angles; `unit` is what their names state, or ""."""
    if unit in ("rad", "deg", "mrad", "mdeg", "turn"):
        return _named(unit)
    peak = float(np.nanmax(np.abs(values)))
    if peak > DEGREES:
        doubts.append(
            f"{signal} reaches {peak:.4g}: neither radians nor degrees (encoder counts?); degrees are assumed"
        )
        return Unit("deg", f"beyond {TURNS:.3g}, so no radians")
    if peak > TURNS and (step := step_of_degrees(values)) is not None:
        return Unit("deg", f"whole encoder ticks of {step:.5g} degrees", "measured")
    lerobot = any(word in m.name for m in columns for word in ("observation", "action", ".pos"))
    if peak > TURNS:
        if lerobot and 90 < peak <= 101:
            doubts.append(
                f"{signal} stays within -100 to 100: degrees, or LeRobot's normalised units (use_degrees: false), of "
                "which the values show no encoder ticks; a calibration file gives the ranges"
            )
        return Unit("deg", f"up to {peak:.4g}, beyond two turns in radians")
    low, high = limits.range.T
    straight, _ = straightened(values, limits.range)  # so that 0 to 2 pi for a range of +-pi does not count as degrees
    outside_as_rad = float(np.mean((straight < low - 0.1) | (straight > high + 0.1)))
    outside_as_deg = float(np.mean((values * FACTORS["deg"] < low) | (values * FACTORS["deg"] > high)))
    if outside_as_rad > 0.02 and outside_as_deg == 0:
        return Unit("deg", f"as radians {outside_as_rad:.0%} of the readings were outside the joints' ranges")
    return Unit("rad", f"up to {peak:.3g}, as radians inside the joints' ranges")


def _speed(unit: str, angle: str) -> Unit:
    """Return the unit of speeds, as `_angle`; `angle` is the unit of the angles."""
    if unit in STATED:
        return _named(unit)
    return Unit("deg/s" if angle == "deg" else "rad/s", f"as the angles are in {angle}")


def _torque(unit: str, values: np.ndarray, limits: Limits, doubts: list[str]) -> Unit:
    """Return the unit of torques, as `_angle`."""
    if unit in ("N m", "mNm", "N cm"):
        return _named(unit)
    peak = np.nanmax(np.abs(values), axis=0, initial=0.0)
    finite = np.isfinite(limits.torque)
    if finite.any() and np.all(peak[finite] < 5e-3 * limits.torque[finite]):
        doubts.append("torques are under 0.5 % of the joints' limits: is their unit N m?")
    if finite.any() and np.any(peak[finite] > 20 * limits.torque[finite]):
        return Unit("mNm", "as N m they would be over twenty times the joints' limits")
    return Unit("N m", "no unit stated; N m does not contradict the joints' limits")


def time_unit(
    time: np.ndarray,
    stated: str,
    stacks: Mapping[str, np.ndarray],
    units: Mapping[str, Unit],
    limits: Limits,
    doubts: list[str],
    speeds: Sequence[str],
) -> Unit:
    """Return the unit of the time: the one that the name states unless the motion excludes it, else the most plausible.

    `speeds` are the possible units of the measured speeds.
    """
    step = np.diff(time)
    period = float(np.median(step[step > 0]))
    dates = [unit for unit in TIMES if EPOCH[0] < float(time[0]) * FACTORS[unit] < EPOCH[1]]
    q = stacks["q"] * FACTORS[units["q"].name]
    measured = [stacks["dq"] * FACTORS[unit] for unit in speeds] if "dq" in stacks else []  # rad/s, by unit tried
    fits = [unit for unit in TIMES if _fits(period * FACTORS[unit], q, measured, step, FACTORS[unit], limits)]

    def rate(unit: str) -> str:
        return f"{1.0 / (period * FACTORS[unit]):.4g} Hz"

    if stated in TIMES:
        if stated in fits or not fits:
            return _named(stated, f": {rate(stated)}")
        doubts.append(f"the time's name says {stated}, which would be {rate(stated)}; the motion allows {fits[0]}")
        return Unit(fits[0], f"{rate(fits[0])}, and speeds that the joints can do")
    if len(dates) == 1:
        return Unit(dates[0], f"dates since 1970 in {dates[0]}: {rate(dates[0])}")
    if len(fits) == 1:
        why = f"{rate(fits[0])}, and speeds that the joints can do; no other unit gives both"
        return Unit(fits[0], why, "measured")
    possible = fits or list(TIMES)
    best = min(possible, key=lambda unit: abs(math.log(1.0 / (period * FACTORS[unit]) / TYPICAL_HZ)))
    others = ", ".join(f"{unit} ({rate(unit)})" for unit in possible if unit != best)
    doubts.append(f"the time may be in {best} ({rate(best)}) or in {others}")
    return Unit(best, f"{rate(best)} is the most usual of what is possible")


def _fits(
    period: float, q: np.ndarray, measured: Sequence[np.ndarray], step: np.ndarray, factor: float, limits: Limits
) -> bool:
    """Test whether the sample rate is usual, and the slopes of the angles are possible and near a measured speed.

    `step` is the time's steps, and `factor` its unit in s.
    """
    if not RATES[0] <= 1.0 / period <= RATES[1]:
        return False
    good = step > 0
    unwrapped, _ = straightened(q)
    speed = np.diff(unwrapped, axis=0)[good] / (step[good] * factor)[:, None]
    top = np.where(np.isfinite(limits.velocity), 3.0 * limits.velocity, TOP_SPEED)
    if np.any(np.nanquantile(np.abs(speed), 0.99, axis=0) > top):
        return False
    ratios = [slope(speed, dq[1:][good]) for dq in measured]
    return not ratios or any(ratio is None or 0.3 < ratio < 3.0 for ratio in ratios)


def speed_unit(time: np.ndarray, q: np.ndarray, dq: np.ndarray, usual: Unit, speeds: Sequence[str]) -> Unit:
    """Return the unit in which measured speeds (n, nj) match the slope of the angles q (n, nj) rad over time (n,) s.

    `usual` is returned if it matches, or if none of `speeds` does.
    """
    step = np.diff(time)
    good = step > 0
    ratio = slope(np.diff(q, axis=0)[good] / step[good][:, None], dq[1:][good])
    if ratio is None:
        return usual
    near = [unit for unit in speeds if 0.5 < ratio * FACTORS[unit] < 2.0]
    if not near or usual.name in near:
        return usual
    return Unit(near[0], f"in {near[0]} they match the change of the angles", "measured")
