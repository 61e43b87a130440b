"""Background: the wall behind the cell stands nearer or further, turned and leaning.

The effects `part_colour`, `part_texture` and `image_texture` change colours and patterns of wall, table and floor.
Native mechanism: `geom_pos` and `geom_quat` of the part `wall` (`geom_sameframe` is cleared, or MuJoCo would ignore
the turn).
"""

from __future__ import annotations

import mujoco
import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.appearance import SceneLook


class Background(SceneLook):
    """Pose of the wall behind the cell."""

    name = "background"
    params = {
        "distance": Param(0.0, -0.4, 2.0, "m", start=0.3, doc="moved away from the robot along the base's x"),
        "yaw": Param(0.0, -0.6, 0.6, "rad", start=0.2, doc="turned about the vertical"),
        "lean": Param(0.0, -0.3, 0.3, "rad", start=0.1, doc="then tilted about the wall's own y axis"),
    }
    writes = frozenset({"geom_pos", "geom_quat", "geom_sameframe"})

    def write(self, fields, p):
        move = np.stack([p[k][:, 0] for k in ("distance", "yaw", "lean")], axis=1)
        for row in np.flatnonzero(move.any(axis=1)):
            distance, yaw, lean = move[row]
            about_z = np.array([np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)])
            about_y = np.array([np.cos(lean / 2), 0, np.sin(lean / 2), 0])
            for name in fields.scene.parts["wall"]:
                g = fields.model.geom(name).id
                quat = fields["geom_quat"][row, g]
                turn, after = np.empty(4), np.empty(4)
                mujoco.mju_mulQuat(turn, about_z, about_y)
                mujoco.mju_mulQuat(after, turn, np.array(quat, float))
                quat[:] = after
                fields["geom_pos"][row, g, 0] += distance
                fields["geom_sameframe"][row, g] = 0
