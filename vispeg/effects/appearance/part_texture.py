"""Part texture: a procedural pattern over a part's colour.

A texel of the texture, by which the part's colour is multiplied, is `1 - amount (1 - t)`. Here t is the pattern's
colour: white where the pattern is 1, a second tone where it is 0.
Native mechanism: pixels of the part's texture (`tex_data`) and the size of its tile (`mat_texrepeat`).
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param, seed_param
from vispeg.core.seeds import stream
from vispeg.effects.common.appearance import PartLook, blend, pixels, where_nonzero
from vispeg.effects.common.colour import rgb_of_hsv
from vispeg.effects.common.texture import CELLS, KINDS


class PartTexture(PartLook):
    """Procedural texture of a part."""

    name = "part_texture"
    order = 50
    params = {
        "amount": Param(0.0, 0.0, 1.0, "1", start=0.8, doc="contrast of the pattern"),
        "kind": Param(
            0.0, 0.0, float(len(KINDS)), "1", start=0.0, shape=True, doc=f"rounded down, index in: {', '.join(KINDS)}"
        ),
        "scale": Param(
            0.03, 0.002, 0.5, "m", start=0.03, shape=True, scale="log", doc="size of a feature of the pattern"
        ),
        "tint": Param(0.0, 0.0, 1.0, "1", start=0.5, shape=True, doc="saturation of the second tone; 0 is grey"),
        "seed": seed_param("seed of pattern and tone", start=1.0),
    }
    writes = frozenset({"tex_data", "mat_texrepeat"})

    def write(self, fields, p):
        makers = list(KINDS.values())
        for row, column, part in where_nonzero(self.targets(fields.scene), p["amount"]):
            value = {name: float(v[row, column]) for name, v in p.items()}
            rng = stream(int(value["seed"]), "part_texture")
            pattern = makers[min(int(value["kind"]), len(makers) - 1)](rng)[..., None]
            tone = rgb_of_hsv(rng.uniform(), np.float64(value["tint"]), rng.uniform(0.15, 0.6))
            texture = pixels(fields, row, part)
            above = (pattern + (1 - pattern) * tone).astype(np.float32)
            texture[:] = blend(texture, texture[..., :3] / np.float32(255) * above, value["amount"])
            fields["mat_texrepeat"][row, fields.model.material(part).id] = 1 / (CELLS * value["scale"])
