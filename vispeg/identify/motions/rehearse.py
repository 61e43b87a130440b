"""Simulate commands before they are recorded, because an arm overshoots its command, most of all near resonance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vispeg.identify.excitation import Motion
from vispeg.identify.record import drive
from vispeg.recordings.recording import Control
from vispeg.robots.model import load
from vispeg.worlds.world import World

SHARE, ENOUGH = 0.95, 0.98  # of a joint's speed limit: target after scaling, and tolerated maximum
ROUNDS, OWN = 6, 2  # trials; trials after which all joints are scaled, because they excite each other


def rehearsed(world: World, motion: Motion, control: Control) -> tuple[Motion, np.ndarray]:
    """Scale the motion so that no joint of this world exceeds its speed limit; return it and the scale factors (nj,).

    The command of a joint that is too fast is scaled around its first angle; if that does not help, because the
    others excite it, all are scaled. Flange commands (osc) stay as they are.

    Raises:
        UserError: the arm does not follow (the controller is unstable with this plant).
    """
    limit = np.asarray(load(world.robot, tool=world.tool).velocity_limit, float)
    share, tried = np.ones(len(limit)), motion
    if motion.ee_cmd is not None or control.mode == "osc" or not np.isfinite(limit).any():
        return motion, share
    for number in range(ROUNDS):
        top = np.nanmax(np.abs(drive(world, tried, control)[1].dq[0]), axis=0)
        over = np.where(np.isfinite(limit) & (limit > 0), top / limit, 0.0)
        if not (over > ENOUGH).any():
            break
        less = SHARE / np.maximum(over, SHARE)
        share = share * (less if number < OWN else less.min())
        first = motion.q_cmd[:1]
        tried = replace(motion, q_cmd=first + share * (motion.q_cmd - first), dq_cmd=share * motion.dq_cmd)
    return tried, share
