"""Lost motion, Coulomb and viscous friction, and backlash from hysteresis loops of a joint's slow strokes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vispeg.measure import loops
from vispeg.measure.friction_curve import friction, line, separable
from vispeg.measure.loops import Stroke
from vispeg.measure.trace import Trace, angle_noise
from vispeg.measure.uncertainty import propagate, rectangular, repeated
from vispeg.worlds.measurement_file import Quantity

SLOW = 0.015  # rad/s, greatest speed at which a reversal shows backlash; if faster, inertia carries the joint across


def summarise(
    strokes: Sequence[Stroke],
    traces: Sequence[Trace],
    results: list[Quantity],
    notes: list[str],
    details: dict[str, object],
    rng: np.random.Generator,
) -> None:
    """Add lost motion, friction and backlash to `results`, remarks to `notes`, the table of strokes to `details`."""
    if not strokes:
        return
    details["torque_speed"] = [
        {
            "speed_rad_s": s.speed,
            "acceleration_rad_s2": s.acceleration,
            "friction_nm": s.friction,
            "load_nm": s.load,
            "lag_rad": s.lag,
            "gap_rad": s.gap,
        }
        for s in sorted(strokes, key=lambda s: s.speed)
    ]
    moving = [s for s in strokes if s.moves]
    if len(moving) < len(strokes):
        notes.append(f"{len(strokes) - len(moving)} of {len(strokes)} strokes are left out: the joint starts or sticks")
    width = 2.0 * np.array([s.lag for s in moving])
    if separable(moving):
        mean = line(moving, width).input("loops at several speeds", 0)
    elif len(moving) >= 2:
        mean = repeated("loops", width)
        notes.append("loops of one speed: the lost motion includes the servo's lag")
    else:
        return
    results.append(propagate("lost_motion", "rad", lambda x: x, [mean], rng, repeats=len(moving)))
    torque = [s for s in moving if s.friction is not None]
    if not torque:
        silent = [t.why for t in traces if t.tau is None]
        why = silent[0] if len(silent) == len(traces) else "the load has no sign"
        notes.append(f"{why}: friction and backlash cannot be separated; the lost motion is the sum of their effects")
        return
    friction(torque, traces, results, notes, details, rng)
    _backlash([s for s in torque if s.speed <= SLOW], results, notes, traces, rng)


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
    noise = angle_noise(traces)
    # the joint turns while the torque is averaged over `loops.SMOOTH`
    turned = 0.5 * loops.SMOOTH * float(max(s.speed for s in with_gap))
    inputs = [repeated("reversals", gaps), rectangular("angle while the torque is smoothed", turned + 2.0 * noise)]
    q = propagate("backlash", "rad", lambda *x: sum(x), inputs, rng, repeats=len(gaps))
    results.append(q)
