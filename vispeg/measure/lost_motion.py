"""What a joint's loops of slow strokes give: lost motion, Coulomb and viscous friction, backlash."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vispeg.measure import loops
from vispeg.measure.loops import Stroke
from vispeg.measure.trace import Trace
from vispeg.measure.uncertainty import Input, propagate, rectangular, repeated
from vispeg.worlds.measurement_file import Quantity

SLOW = 0.015  # rad/s, up to which a reversal shows its backlash: faster, the loop is crossed in flight


def summarise(
    strokes: Sequence[Stroke],
    traces: Sequence[Trace],
    results: list[Quantity],
    notes: list[str],
    details: dict[str, object],
    rng: np.random.Generator,
) -> None:
    """Adds lost motion, friction and backlash to `results`, remarks to `notes`, the table of strokes to `details`."""
    if not strokes:
        return
    details["torque_speed"] = [
        {"speed_rad_s": s.speed, "friction_nm": s.friction, "load_nm": s.load, "lag_rad": s.lag, "gap_rad": s.gap}
        for s in sorted(strokes, key=lambda s: s.speed)
    ]
    speed = np.array([s.speed for s in strokes])
    width = 2.0 * np.array([s.lag for s in strokes])
    if len(strokes) >= 3 and np.ptp(speed) > 0.5 * speed.min():
        x, cov, dof = loops.line(speed, width)
        mean = Input("loops at several speeds", float(x[0]), float(np.sqrt(cov[0, 0])), "A", float(dof), "t")
    elif len(strokes) >= 2:
        mean = repeated("loops", width)
        notes.append("loops of one speed: the lost motion holds the servo's lag too")
    else:
        return
    results.append(propagate("lost_motion", "rad", lambda x: x, [mean], rng, repeats=len(strokes)))
    torque = [s for s in strokes if s.friction is not None]
    if not torque:
        silent = [t.why for t in traces if t.tau is None]
        why = silent[0] if len(silent) == len(traces) else "the load has no sign"
        notes.append(f"{why}: friction and backlash are not told apart; the lost motion is the sum of what they do")
        return
    _friction(torque, results, notes, rng)
    _backlash([s for s in torque if s.speed <= SLOW], results, notes, traces, rng)


def _friction(torque: Sequence[Stroke], results: list[Quantity], notes: list[str], rng: np.random.Generator) -> None:
    speed, height = np.array([s.speed for s in torque]), np.array([s.friction for s in torque], float)
    if len(torque) < 3 or np.ptp(speed) <= 0.5 * speed.min():
        if len(torque) >= 2:
            inputs = [repeated("loops", height)]
            results.append(propagate("friction", "N m", lambda x: x, inputs, rng, repeats=len(torque)))
            notes.append("one speed: Coulomb and viscous friction are not told apart")
        return
    # the inertia that what is left of each start has moved is a third unknown, not determined
    acceleration = np.array([s.acceleration for s in torque]) if len(torque) >= 6 else None
    x, cov, dof = loops.line(speed, height, acceleration)
    for name, unit, k in (("coulomb_friction", "N m", 0), ("viscous_friction", "N m s/rad", 1)):
        scatter = Input("loop heights about their line", float(x[k]), float(np.sqrt(cov[k, k])), "A", float(dof), "t")
        results.append(propagate(name, unit, lambda x: x, [scatter], rng, repeats=len(torque)))
    slow = speed < 0.01
    if slow.any() and (~slow).sum() >= 3:
        y, rest, free = loops.line(speed[~slow], height[~slow])
        excess = float(height[slow].mean() - y[0])
        u = np.sqrt(rest[0, 0] * (1 + 1 / slow.sum()))
        if free > 0 and excess > 3 * u > 0:
            notes.append(f"below 0.01 rad/s {excess:.2g} N m more than the line says: Stribeck friction")


def _backlash(
    slow: Sequence[Stroke],
    results: list[Quantity],
    notes: list[str],
    traces: Sequence[Trace],
    rng: np.random.Generator,
) -> None:
    with_gap = [s for s in slow if s.gap is not None]
    gaps = np.array([s.gap for s in with_gap], float)
    if len(gaps) < 2:
        if slow:
            load = np.mean([abs(s.load or 0.0) for s in slow])
            friction = np.mean([s.friction or 0.0 for s in slow])
            reason = f"the load of {load:.2g} N m keeps the teeth on one side (friction {friction:.2g} N m)"
            notes.append(
                "backlash is not shown: " + (reason if load > friction else "the loop's height is in the noise")
            )
        return
    noise = float(np.median([np.std(np.diff(t.q, 2)) for t in traces])) / np.sqrt(6.0)
    # the torque is smoothed over a while in which the joint turns
    turned = 0.5 * loops.SMOOTH * float(max(s.speed for s in with_gap))
    inputs = [repeated("reversals", gaps), rectangular("angle while the torque is smoothed", turned + 2.0 * noise)]
    q = propagate("backlash", "rad", lambda *x: sum(x), inputs, rng, repeats=len(gaps))  # type: ignore[arg-type]
    results.append(q)
