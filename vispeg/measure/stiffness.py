"""Stiffness of a fixture: presses on a rigid stop, then on the fixture, at two arm poses or more.

What gives way in a press is the arm, its sensor and the fixture, in series: their compliances add, so the fixture's is
c_fixture - c_stop in the same pose. Compliance of the arm turns with its pose and the fixture's does not, so that poses
that disagree say that the subtraction does not hold.
"""

from __future__ import annotations

import numpy as np
from scipy import stats

from vispeg.core.errors import UserError
from vispeg.measure.outcome import Outcome, short
from vispeg.measure.readings import REPEATS_AGREE, Readings, choose
from vispeg.measure.uncertainty import Input, propagate, rectangular, repeated

FORMS = {"presses on stop (0) and fixture (1)": ("force", "depth", "on")}
POSES, LEAST, RAMP = 2, 5.0, 3  # poses; N, below which the contact itself still closes; readings of a ramp


def measure(readings: Readings, rng: np.random.Generator) -> Outcome:
    """Give the stiffness in N/m, and the compliance in m/N that it is the inverse of.

    Args:
        readings: `force` (N), `depth` (m), `on` (0 a rigid stop, 1 the fixture); `pose` and `ramp` (numbers) where
            there are several. Loading and unloading count as two ramps.
        rng: of the Monte Carlo propagation.

    Raises:
        UserError: no press on the stop or on the fixture in some pose, a ramp of one force, poses that disagree, a
            fixture no softer than the stop.
    """
    choose(readings, FORMS)
    slopes = _slopes(readings)
    poses = sorted({pose for pose, _, _ in slopes})
    differences, spreads = [], []
    for pose in poses:
        stop, on = ([c for (p, o, _), c in slopes.items() if p == pose and o == side] for side in (0, 1))
        if not stop or not on:
            missing = "rigid stop (on = 0)" if not stop else "fixture (on = 1)"
            raise UserError(f"pose {pose:g} has no press on the {missing}", file=readings.file)
        differences.append(float(np.mean(on) - np.mean(stop)))
        spreads.append(_spread(stop) + _spread(on))
    means = np.array(differences)
    if len(means) > 1 and all(d > 0 for _, d in spreads):
        _refuse_disagreement(means, spreads, readings)
    inputs = [_mean(means, spreads), *_instrument(readings, float(means.mean()))]
    soft = propagate("compliance", "m/N", lambda c, *e: c * (1 + sum(e)), inputs, rng, repeats=len(slopes))
    if soft.low <= 0:
        got = f"{soft.value:.3g} m/N more, 95 % interval {soft.low:.3g} to {soft.high:.3g}"
        raise UserError("the fixture is no softer than the stop, as far as this can tell", file=readings.file, got=got)
    stiff = propagate("stiffness", "N/m", lambda c, *e: 1.0 / (c * (1 + sum(e))), inputs, rng, repeats=len(slopes))
    notes = short(len(poses), POSES, "arm pose", "" if "pose" in readings.columns else "pose")
    rows = [
        {"pose": p, "on": "fixture" if o else "stop", "ramp": n, "compliance_m_per_n": c}
        for (p, o, n), c in slopes.items()
    ]
    return Outcome((stiff, soft), tuple(notes), {"ramps": rows})


def _slopes(r: Readings) -> dict[tuple[float, int, float], float]:
    """(pose, on, ramp) -> compliance in m/N of each press, by least squares above `LEAST` newtons."""
    zero = np.zeros(len(r))
    pose, ramp, on = r.columns.get("pose", zero), r.columns.get("ramp", zero), r["on"]
    odd = np.flatnonzero((on != 0) & (on != 1))
    if len(odd):
        key = f"row {odd[0] + 2}, column on"
        raise UserError("is neither", file=r.file, key=key, expected="0 (stop) or 1 (fixture)", got=float(on[odd[0]]))
    out = {}
    for p, o, n in sorted(set(zip(pose.tolist(), on.tolist(), ramp.tolist(), strict=True))):
        rows = (pose == p) & (on == o) & (ramp == n) & (r["force"] >= LEAST)
        if rows.sum() < RAMP or np.ptp(r["force"][rows]) < LEAST:
            what = f"pose {p:g}, on {o:g}, ramp {n:g}"
            expected = f"{RAMP} readings or more that span {LEAST:g} N above {LEAST:g} N"
            raise UserError("is not a ramp", file=r.file, key=what, expected=expected, got=int(rows.sum()))
        force = r["force"][rows] - r["force"][rows].mean()
        out[p, int(o), n] = float(force @ r["depth"][rows] / (force @ force))
    return out


def _spread(values: list[float]) -> np.ndarray:
    """(sum of squares of the mean's standard uncertainty, degrees of freedom) of one group of ramps."""
    n = len(values)
    return np.array([np.var(values, ddof=1) / n if n > 1 else 0.0, n - 1.0])


def _mean(means: np.ndarray, spreads: list[np.ndarray]) -> Input:
    """Give the mean over poses; its spread from the poses, or from the ramps where there is one pose."""
    if len(means) > 1:
        between = repeated(f"{len(means)} arm poses", means)
        within = float(np.sqrt(sum(s for s, _ in spreads))) / len(means)
        dof = float(sum(d for _, d in spreads))
        # two poses alone say little of their own spread; where ramps say more, and poses agree with them, they are used
        if dof > between.dof:
            return Input("repeats of the ramps", float(means.mean()), max(within, between.u), "A", dof, "t")
        return between
    s, dof = spreads[0]
    if dof <= 0:
        raise UserError("one ramp a side has no spread", expected="two ramps or more, or two poses")
    return Input("repeats of the ramps", float(means[0]), float(np.sqrt(s)), "A", float(dof), "t")


def _refuse_disagreement(means: np.ndarray, spreads: list[np.ndarray], r: Readings) -> None:
    u = np.sqrt(sum(s for s, _ in spreads))
    dof = sum(d for _, d in spreads)
    most = float(stats.t.isf(stats.norm.sf(REPEATS_AGREE), dof) * u)
    if np.ptp(means) > most > 0:
        got, expected = f"{np.ptp(means):.3g} m/N apart", f"under {most:.3g}"
        raise UserError(
            "the arm poses disagree: its own compliance is not subtracted", file=r.file, expected=expected, got=got
        )


def _instrument(r: Readings, compliance: float) -> list[Input]:
    """Relative errors of the compliance from what the instruments leave open over the range of a ramp."""
    span = np.ptp(r["force"])
    out = [rectangular(error.name, error.u * np.sqrt(3.0) / span) for error in r.instrument("force")]
    return out + [
        rectangular(error.name, error.u * np.sqrt(3.0) / (span * compliance)) for error in r.instrument("depth")
    ]
