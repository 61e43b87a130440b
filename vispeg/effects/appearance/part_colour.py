"""Part colour: a part takes a colour anywhere in HSV; `c = (1 - amount) c_nominal + amount hsv(...)`.

Native mechanism: `mat_rgba` of the part's material; `geom_rgba` where a geom has none (the arm's links).
"""

from __future__ import annotations

from vispeg.core.effect import Effect
from vispeg.core.params import Param
from vispeg.effects.common.appearance import where_nonzero
from vispeg.effects.common.colour import rgb_of_hsv


class PartColour(Effect):
    """Colour of a part."""

    name = "part_colour"
    family = "appearance"
    order = 40
    params = {
        "amount": Param(0.0, 0.0, 1.0, "1", start=1.0, doc="share of the new colour; the rest is nominal"),
        "hue": Param(0.0, 0.0, 1.0, "turn", start=0.6, shape=True, doc="0 red, 1/3 green, 2/3 blue"),
        "saturation": Param(0.0, 0.0, 1.0, "1", start=0.7, shape=True, doc="0 grey, 1 pure"),
        "value": Param(0.0, 0.0, 1.0, "1", start=0.6, shape=True, doc="0 black, 1 bright"),
    }
    writes = frozenset({"mat_rgba", "geom_rgba"})

    def targets(self, model):
        return [part for part in getattr(model, "parts", {}) if part != "distractors"]  # these set their own

    def write(self, fields, p):
        colour = rgb_of_hsv(p["hue"], p["saturation"], p["value"])
        model = fields.model
        for row, column, part in where_nonzero(self.targets(fields.scene), p["amount"]):
            amount = p["amount"][row, column]
            geoms = [model.geom(name).id for name in fields.scene.parts[part]]
            materials = {int(model.geom_matid[g]) for g in geoms}
            places = [("mat_rgba", m) for m in sorted(materials - {-1})]
            places += [("geom_rgba", g) for g in geoms if model.geom_matid[g] < 0]
            for field, i in places:
                rgb = fields[field][row, i, :3]
                rgb[:] = (1 - amount) * rgb + amount * colour[row, column]
