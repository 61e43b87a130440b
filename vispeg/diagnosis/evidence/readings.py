"""Read encoder resolutions from the measured angles alone: all angles of a joint are integer multiples of one step.

A fit cannot find a step below about ten times the noise: noise tips a rounded prediction to the next step as often as
the reading itself, so the squared error is as large as without rounding. The grid is visible in the readings
themselves.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vispeg.core.effect import REGISTRY, EffectInstance
from vispeg.core.params import Value
from vispeg.core.rules import RULES
from vispeg.recordings.checks.quality import FEWEST, quantization
from vispeg.recordings.noise import noise_of
from vispeg.recordings.recording import Recording
from vispeg.worlds.places import ALL
from vispeg.worlds.world import World


def gridded(world: World, recordings: Sequence[Recording]) -> tuple[EffectInstance, ...]:
    """Return encoder resolutions of joints that have the same step in every recording in which they move.

    The grid must contain the joint's zero, as the effect's grid does. If one step fits all moving joints, it is a
    single effect at `all`. A joint for which the world has a resolution is skipped. The value has as its interval the
    steps that leave all readings on the grid (`RULES.grid_off`).
    """
    joints = recordings[0].joints
    moved = {j: [r for r in recordings if moves(r.q[:, j])] for j in range(len(joints))}
    moved = {j: recorded for j, recorded in moved.items() if recorded}
    steps = {j: common_step(m, j) for j, m in moved.items()}
    known = [s for s in steps.values() if s]
    shared = float(np.median(known)) if known else 0.0  # the step of all joints, if they are alike
    alike = (
        len(steps) > 1
        and bool(known)
        and all(abs(s - shared) < RULES.grid_off * shared for s in known)  # twice the step would fit its grid too
        and all(on_grid(r.q[:, j], shared) for j, m in moved.items() for r in m)
    )
    out: list[EffectInstance] = []
    for name, kind in sorted(REGISTRY.items()):
        if not kind.overrides("resolution"):
            continue
        (param,) = kind.magnitudes
        has = {e.where for e in world.effects if e.effect == name}
        places = {joints[j]: ([j], s) for j, s in steps.items() if s and joints[j] not in has and ALL not in has}
        if alike and not has:
            places = {ALL: (list(steps), shared)}
        for where, (numbers, step) in places.items():
            if step <= kind.params[param].high:
                widest = max(float(np.nanmax(np.abs(r.q[:, j]))) for j in numbers for r in moved[j])
                width = RULES.grid_off * step**2 / widest  # a step longer by this takes the widest reading off the grid
                placed = EffectInstance.of(name, where, **{param: step})
                value = Value(step, step - width, step + width)
                out.append(EffectInstance(name, where, {**placed.params, param: value}))
    return tuple(out)


def moves(values: np.ndarray) -> bool:
    """Return whether readings (n,) have enough different values to show a step (`quantization`)."""
    return len(np.unique(values[np.isfinite(values)])) > FEWEST


def common_step(recordings: Sequence[Recording], joint: int) -> float:
    """Return the step in rad of joint number `joint` that all these recordings have; 0 if there is none.

    A step counts only if it is more than `RULES.grid_step` times the noise.
    """
    if any(quantization(r.q[:, joint]) is None for r in recordings):
        return 0.0
    widest = max((r.q[:, joint] for r in recordings), key=lambda q: float(np.nanmax(np.abs(q))))
    step = refined(widest, quantization(widest) or 0.0)
    clear = all(step > RULES.grid_step * noise_of(r)["q"][joint] for r in recordings)
    return step if clear and all(on_grid(r.q[:, joint], step) for r in recordings) else 0.0


def refined(values: np.ndarray, step: float) -> float:
    """Refine a step (rad) by least squares over values (n,) rad, small ones first: their number of steps is certain."""
    values = values[np.isfinite(values)]
    for share in (0.1, 0.3, 1.0):
        small = values[np.abs(values) <= share * np.abs(values).max()]
        counts = np.round(small / step)
        if counts.any():
            step = float(small @ counts / (counts @ counts))
    return step


def on_grid(values: np.ndarray, step: float) -> bool:
    """Return whether values (n,) are integer multiples of a step."""
    counts = values[np.isfinite(values)] / step
    return bool(np.abs(counts - np.round(counts)).max(initial=0.0) < RULES.grid_off)
