"""Cable spring: a dress pack or umbilical pulls the joint to an angle, `tau = -stiffness (q - reference)`.

Native mechanism: `jnt_stiffness` with `qpos_spring`, in parallel with the joint's own spring. It acts on the link,
outside the gear, so a joint torque sensor feels it as load. Source: MuJoCo 4.0 manual, body/joint/stiffness and
springref.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.params import Param


class CableSpring(Effect):
    """Linear spring across the joint."""

    name = "cable_spring"
    family = "joint"
    conservative = True
    moments = ("reference",)
    params = {
        "stiffness": Param(0.0, 0.0, 60.0, "N m/rad", start=1.0, doc="stiffness of the cable"),
        "reference": Param(0.0, -3.2, 3.2, "rad", start=0.0, shape=True, doc="angle at which it is slack"),
    }
    writes = frozenset({"jnt_stiffness", "qpos_spring"})

    def write(self, fields, p):
        nominal, slack = fields["jnt_stiffness"][:, fields.joints], fields["qpos_spring"][:, fields.qposes]
        total = nominal + p["stiffness"]
        share = np.divide(p["stiffness"], total, out=np.zeros_like(total), where=total != 0)
        fields["jnt_stiffness"][:, fields.joints] = total
        fields["qpos_spring"][:, fields.qposes] = slack + share * (p["reference"] - slack)

    def side(self):
        return "link"

    def guesses(self, look):
        """Return the slack angle of a line that is fitted to the missing torque over the angle."""
        if np.ptp(look.q) < 1e-4:  # at rest there is no line to fit
            return [{"reference": 0.0}]
        slope, intercept = np.polyfit(look.q, look.excess, 1)
        low, high = self.params["reference"].low, self.params["reference"].high
        reference = float(np.clip(-intercept / slope, low, high)) if abs(slope) > 1e-9 else 0.0
        return [{"reference": reference}]
