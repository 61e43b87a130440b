"""Position of the hand if the arm yields behind its encoders: `-J C (tau - tau_0)` off the measured path.

A joint's torque is due to the weight of its links and to the wrench of the flange on the tool, `g(q) + J' W`; `tau_0`
is its value at the start of the episode.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vispeg.contact.inputs import ContactItem
from vispeg.contact.path import PATH_HZ, jacobian
from vispeg.core.effect import effect
from vispeg.recordings.differentiate import bridged, smooth
from vispeg.sim.external import flange_jacobian, needed
from vispeg.worlds.places import values
from vispeg.worlds.world import World

EVERY = 0.02  # s between the sampled postures


def yielding(world: World) -> World:
    """Return the effects of a world that make the arm compliant."""
    return world.only(lambda e: effect(e.effect).overrides("yields"))


def arm_displacement(item: ContactItem, worlds: Sequence[World], wrench: np.ndarray) -> np.ndarray | None:
    """Return the displacement of each world's hand from the measured path.

    Args:
        item: an episode.
        worlds: worlds with the effects that a wrench can show.
        wrench: (nworld, n, 6) N, N m, wrench on the tool according to each world's sensor without its zero, flange
            axes; a zero would not cancel, because J changes along the path.

    Returns:
        (nworld, 2, n, 6): the hand's coordinates (m, rad) minus the path's, and their rates; None if no world yields.
    """
    soft = [yielding(w) for w in worlds]
    if not any(w.effects for w in soft):
        return None
    path, arm = item.path, item.source.scene.nominal
    time = path.time
    sampled = slice(None, None, max(1, round(EVERY * item.recording.rate_hz)))
    clock, q = path.clock[sampled], bridged(path.clock, item.recording.q[path.rows])[sampled]
    jac, still = flange_jacobian(arm, q), np.zeros_like(q)
    weight = needed(arm, q, still, still)
    turn = jacobian(np.stack([np.interp(clock, time, a) for a in path.place[:, 3:].T], axis=1))

    def on_steps(v: np.ndarray) -> np.ndarray:
        flat = v.reshape(len(clock), -1)
        return np.stack([np.interp(time, clock, c) for c in flat.T], axis=1).reshape(len(time), *v.shape[1:])

    jac, weight = on_steps(jac), on_steps(weight)
    to_hand = on_steps(np.linalg.inv(np.swapaxes(turn, 1, 2)))  # twist in flange axes -> rates
    out = np.zeros((len(worlds), 2, len(time), 6))
    for w, world in enumerate(soft):
        if not world.effects:
            continue
        load = weight + np.einsum("nij,ni->nj", jac, wrench[w])
        load, behind = load - load[item.phase.rest].mean(axis=0), np.zeros_like(load)
        for kind in dict.fromkeys(effect(e.effect) for e in world.effects):
            p = values(kind, [world.effects], item.source.scene)
            behind += kind.yields(load, p)
        off = np.einsum("nij,njk,nk->ni", to_hand, jac, -behind)
        out[w] = smooth(time, off, PATH_HZ)[:2]
    return out
