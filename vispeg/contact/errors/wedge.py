"""Rotation of a wedged part in compliant walls, due to a normal force that the sensor does not measure.

A rocked part bears on the mouth and, the other way, on the wall at its tip. A sensor reads the difference of the two
forces; their sum, many times as large, shows in the couple alone: `N1 + N2 = 2 M / h`, `N1 - N2 = F` over a depth h
(Whitney 1982, Quasi-static assembly of compliantly supported rigid parts, J. Dyn. Sys. Meas. Control 104). In the model
a wall is as stiff as all of its flat pieces that touch there together; a real wall may be as stiff as one of them.
"""

from __future__ import annotations

import numpy as np

from vispeg.contact.inputs import ContactItem
from vispeg.contact.path import tips
from vispeg.core.rules import RULES
from vispeg.effects.common.parts import shapes
from vispeg.effects.common.solref import springs
from vispeg.robots.scene import Scene
from vispeg.sim.compiled import compiled


def softness(scene: Scene) -> float:
    """Return the compliance in m/N of one contact of the held part at low force: `(1 - d) w / (d k)`.

    Here `k = K d / d1^2` with solref's stiffness K and solimp (d, d1, ..), and w is the inverse weight of the part's
    body. Source: MuJoCo 4.0 manual, Modeling, Solver parameters.
    """
    model = compiled(scene)
    body, geom = model.body(scene.held).id, shapes(model, scene.held)[0]
    (stiffness, _), (d, d1) = springs(model.geom_solref[geom]), model.geom_solimp[geom, :2]
    return float((1 - d) * model.body_invweight0[body, 0] * (d1 / d) ** 2 / stiffness)


def wedging(item: ContactItem) -> np.ndarray:
    """Return the root of `N1^2 + N2^2` of the forces across a wedged part, (m,) N; 0 where it does not wedge."""
    scene, contact = item.source.scene, item.phase.contact
    tip = tips(item.path, scene)[item.phase.rows(item.path.time)]
    depth, over = -tip[:, 2], np.hypot(tip[:, 0], tip[:, 1]) < 2 * scene.config.apothem
    middle = scene.tip - 0.5 * depth  # m along the flange's z, halfway between the two forces
    couple = contact[:, 3:5] - middle[:, None] * np.stack([-contact[:, 1], contact[:, 0]], axis=1)
    across = np.linalg.norm(contact[:, :2], axis=1)
    both = 2 * np.linalg.norm(couple, axis=1) / np.maximum(depth, RULES.wedge_depth)
    wedged = over & (depth > RULES.wedge_depth) & (both > RULES.wedge_surely * across)
    return np.where(wedged, np.sqrt(0.5 * (both**2 + across**2)), 0.0)
