"""What the readings of encoders show by themselves: all of them are whole multiples of one step.

No squared error shows a step of less than some ten times the noise: noise tips a rounded prediction over to the next
step as often as the reading itself, which leaves as much as no rounding does. The grid is there to be seen.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vispeg.core.effect import REGISTRY, EffectInstance
from vispeg.core.params import Value
from vispeg.recordings.checks.quality import quantization
from vispeg.recordings.noise import noise_of
from vispeg.recordings.recording import Recording
from vispeg.worlds.places import ALL
from vispeg.worlds.world import World

LOUDER = 4.0  # times the noise: the least step; one of sqrt(12) times it is the noise itself
AGREE = 0.01  # of a step, by which readings are off a grid and recordings off one another
WIDTH = 0.05  # of a step over the whole of a motion: how exactly its ends fix the step


def gridded(world: World, recordings: Sequence[Recording]) -> tuple[EffectInstance, ...]:
    """Effects by which encoders read in steps, of joints of which every recording shows the same one.

    One effect of all joints where these have one step, none of a joint for which the world has one already.
    """
    joints = recordings[0].joints
    steps = np.array([common_step(recordings, j) for j in range(len(joints))])
    out: list[EffectInstance] = []
    for name, kind in sorted(REGISTRY.items()):
        if not kind.overrides("resolution"):
            continue
        has = {e.where for e in world.effects if e.effect == name}
        free = np.array([ALL not in has and joint not in has for joint in joints])
        (param,) = kind.magnitudes
        whole = free.all() and steps.all() and np.ptp(steps) < AGREE * steps[0]
        places = {ALL: float(steps.mean())} if whole else dict(zip(joints, np.where(free, steps, 0.0), strict=True))
        for where, step in places.items():
            rows = range(len(joints)) if where == ALL else [joints.index(where)]
            turn = max(float(np.nanmax(r.q[:, j]) - np.nanmin(r.q[:, j])) for r in recordings for j in rows)
            if kind.params[param].null < step <= kind.params[param].high:
                off = WIDTH * step**2 / max(turn, step)
                placed = EffectInstance.of(name, where, **{param: step})
                out.append(EffectInstance(name, where, {**placed.params, param: Value(step, step - off, step + off)}))
    return tuple(out)


def common_step(recordings: Sequence[Recording], joint: int) -> float:
    """rad: the step that a joint is read in, in every recording; 0 where there is none, or none beyond its noise."""
    steps = [quantization(r.q[:, joint]) or 0.0 for r in recordings]
    if min(steps) <= 0 or np.ptp(steps) > AGREE * max(steps):
        return 0.0
    step = float(np.median(steps))
    louder = all(step > LOUDER * noise_of(r)["q"][joint] for r in recordings)
    return step if louder and all(on_grid(r.q[:, joint], step) for r in recordings) else 0.0


def on_grid(values: np.ndarray, step: float) -> bool:
    """Whether values (n,) next to one another differ by whole steps."""
    moves = np.diff(values[np.isfinite(values)]) / step
    return bool(np.abs(moves - np.round(moves)).max(initial=0.0) < AGREE)
