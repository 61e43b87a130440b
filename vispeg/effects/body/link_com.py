"""Link centre of mass: it lies (x, y, z) m from the model's, in the link's body frame.

Native mechanism: `body_ipos`; the inertia about the centre of mass is kept.
"""

from __future__ import annotations

from vispeg.core.effect import Effect
from vispeg.core.params import Param


class LinkCom(Effect):
    """Error of a link's centre of mass."""

    name = "link_com"
    family = "body"
    likelier = ("payload",)
    params = {
        axis: Param(0.0, -0.15, 0.15, "m", start=0.01, doc=f"shift along the body's {axis} axis") for axis in "xyz"
    }
    writes = frozenset({"body_ipos"})

    def targets(self, model):
        return list(model.links)

    def write(self, fields, p):
        for column, body in enumerate(fields.links):
            for i, axis in enumerate("xyz"):
                fields["body_ipos"][:, body, i] += p[axis][:, column]

    def side(self):
        return "link"
