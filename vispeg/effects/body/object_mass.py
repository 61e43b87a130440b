"""Object mass: the held part, or a free object, has `scale` times its nominal mass.

Native mechanism: `body_mass` and `body_inertia` of the body, both in proportion (the same shape, another density).

In any orientations, the readings of a wrist sensor determine mass, centre of mass and inertia of tool and held part
together, not the share of each. So a change of the tool's mass and centre of mass can always replace a change of the
part's mass; the two differ in inertia alone, by less than the readings show. Source: Atkeson, An and Hollerbach 1986,
Estimation of inertial parameters of manipulator loads and links, Int. J. Robotics Research 5(3).
"""

from __future__ import annotations

import mujoco
import numpy as np

from vispeg.core.effect import Effect, EffectInstance, effect
from vispeg.core.params import Param
from vispeg.effects.common.parts import held


class ObjectMass(Effect):
    """Scale of a held or free object's mass and inertia."""

    name = "object_mass"
    family = "body"
    searchable = False
    params = {"scale": Param(1.0, 0.05, 10.0, "1", start=1.3, scale="log", doc="mass over nominal")}
    writes = frozenset({"body_mass", "body_inertia"})
    stage = "free air"
    sizes = {"scale": (0.4, 2.0)}
    shown_by = ("free",)
    told_from = {
        "tool_mass": "free, with and without the held part",
        "wrench_bias": "free",
        "wrench_gain": "free",
    }
    needs = "weighing"

    def targets(self, model):
        return [*held(model), *getattr(model, "free", ())]

    def write(self, fields, p):
        for column, name in enumerate(self.targets(fields.robot)):
            body, scale = fields.model.body(name).id, p["scale"][:, column]
            fields["body_mass"][:, body] *= scale
            fields["body_inertia"][:, body] *= scale[:, None]

    def imitated_by(self, scene, model, p):
        """Return the tool's mass and centre of mass with the same weight and leverage, cut to their bounds."""
        tools = effect("tool_mass").targets(scene)
        if not tools or not scene.held:
            return ()
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        flange = data.site(scene.flange)
        tool, part = (model.body(name).id for name in ("tool", scene.held))
        height = (data.xipos - flange.xpos) @ flange.xmat.reshape(3, 3)[:, 2]  # m, along the flange's z
        mass = float((p["scale"] - 1.0) * model.body_mass[part])
        z = mass * (height[part] - height[tool]) / (model.body_mass[tool] + mass)
        limits = effect("tool_com").params["z"]
        centre = EffectInstance.of("tool_com", tools[0], z=float(np.clip(z, limits.low, limits.high)))
        return EffectInstance.of("tool_mass", tools[0], mass=mass), centre
