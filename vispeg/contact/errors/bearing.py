"""Uncertain bearing point of a part pressed flat on a surface, which no model predicts.

A flat end touches at points that depend on its shape and on micrometres of tilt. A simulator uses four points of its
rim. Their square supports the part up to 0.3 radii nearer to the axis than the full circle would; half of that counts
as one standard deviation (`bears_aside`). The lever of the normal force then differs, and the hand, held to its path by
soft springs, turns about the sticking tip until the springs balance the couple.
"""

from __future__ import annotations

import numpy as np

from vispeg.contact.hand import stiffness
from vispeg.contact.inputs import ContactItem
from vispeg.core.rules import RULES
from vispeg.recordings.checks.quality import runs


def bearing(item: ContactItem) -> list[np.ndarray]:
    """Return possible errors of the predicted wrench, each (m, 6) N and N m for m blocks of time.

    There are two for each stretch in which the tip sticks (phase `press`): it bears off the axis by `bears_aside`
    radii, so that the hand turns about either of the two axes across the tool.
    """
    scene, phase, springs = item.source.scene, item.phase, stiffness()  # springs: x, y, z, then about x, y, z
    radius, tip = scene.config.diameter / 2, scene.tip
    couple = RULES.bears_aside * radius * np.abs(phase.contact[:, 2])  # N m; the normal force is along the tool's z
    turn = couple / (springs[3] + springs[0] * tip**2)  # rad, about the tip
    # wrench for a turn of 1 rad about the tip, which lies along the flange's z: turned about x, the hand moves along y
    force, torque = springs[0] * tip, springs[3]
    about_x = np.array([0.0, force, 0.0, torque, 0.0, 0.0])
    about_y = np.array([-force, 0.0, 0.0, 0.0, torque, 0.0])
    out = []
    for a, b in runs(phase.of("press")):
        size = np.zeros(len(turn))
        size[a:b] = turn[a:b]
        out += [np.outer(size, about_x), np.outer(size, about_y)]
    return out
