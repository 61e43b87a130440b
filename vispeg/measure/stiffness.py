"""Stiffness of a fixture: presses on a rigid stop, then on the fixture, at two arm poses or more.

In a press the arm, its sensor and the fixture give way in series. Their compliances add, so the fixture's is
c_fixture - c_stop in the same pose. The arm's compliance depends on its pose and the fixture's does not: if poses
disagree, the subtraction is not valid.
"""

from __future__ import annotations

import numpy as np
from scipy import stats

from vispeg.core.errors import UserError
from vispeg.measure.outcome import Outcome, short
from vispeg.measure.readings import REPEATS_AGREE, Readings, choose
from vispeg.measure.uncertainty import Input, propagate, rectangular, repeated

FORMS = {"presses on stop (0) and fixture (1)": ("force", "depth", "on")}
# number of poses that the protocol asks for; least force that is used, N (below it the contact itself still closes);
# least number of readings in a ramp
POSES, LEAST, RAMP = 2, 5.0, 3


def measure(readings: Readings, rng: np.random.Generator) -> Outcome:
    """Compute the stiffness in N/m, and its inverse, the compliance in m/N.

    Args:
        readings: `force` (N), `depth` (m), `on` (0 for the rigid stop, 1 for the fixture); `pose` and `ramp` (numbers)
            if there are several. Loading and unloading count as two ramps.
        rng: of the Monte Carlo propagation.

    Raises:
        UserError: no press on the stop or on the fixture in some pose, a ramp with too few readings or too small a
            range of forces, poses that disagree, or a fixture that is not significantly softer than the stop.
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
        raise UserError("the fixture is not significantly softer than the stop", file=readings.file, got=got)
    stiff = propagate("stiffness", "N/m", lambda c, *e: 1.0 / (c * (1 + sum(e))), inputs, rng, repeats=len(slopes))
    notes = short(len(poses), POSES, "arm pose", "" if "pose" in readings.columns else "pose")
    rows = [
        {"pose": p, "on": "fixture" if o else "stop", "ramp": n, "compliance_m_per_n": c}
        for (p, o, n), c in slopes.items()
    ]
    return Outcome((stiff, soft), tuple(notes), {"ramps": rows})


def _slopes(r: Readings) -> dict[tuple[float, int, float], float]:
    """Return (pose, on, ramp) -> compliance of each press, m/N, by least squares above `LEAST` N."""
    zero = np.zeros(len(r))
    pose, ramp, on = r.columns.get("pose", zero), r.columns.get("ramp", zero), r["on"]
    odd = np.flatnonzero((on != 0) & (on != 1))
    if len(odd):
        key = f"{r.row(odd[0])}, column on"
        raise UserError(
            "is neither 0 nor 1", file=r.file, key=key, expected="0 (stop) or 1 (fixture)", got=float(on[odd[0]])
        )
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
    """Return the squared standard uncertainty of the mean of one group of ramps, and its degrees of freedom, (2,)."""
    n = len(values)
    return np.array([np.var(values, ddof=1) / n if n > 1 else 0.0, n - 1.0])


def _mean(means: np.ndarray, spreads: list[np.ndarray]) -> Input:
    """Return the mean over poses, with its uncertainty from the poses or, for a single pose, from the ramps."""
    if len(means) > 1:
        between = repeated(f"{len(means)} arm poses", means)
        within = float(np.sqrt(sum(s for s, _ in spreads))) / len(means)
        dof = float(sum(d for _, d in spreads))
        # two poses give a poor estimate of their spread: ramps are used if they have more degrees of freedom
        if dof > between.dof:
            return Input("repeats of the ramps", float(means.mean()), max(within, between.u), "A", dof, "t")
        return between
    s, dof = spreads[0]
    if dof <= 0:
        raise UserError("one ramp per side has no spread", expected="two ramps or more, or two poses")
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
    """Return the relative errors of the compliance due to the instruments' errors over the range of a ramp."""
    span = np.ptp(r["force"])
    out = [rectangular(error.name, error.u * np.sqrt(3.0) / span) for error in r.instrument("force")]
    return out + [
        rectangular(error.name, error.u * np.sqrt(3.0) / (span * compliance)) for error in r.instrument("depth")
    ]
