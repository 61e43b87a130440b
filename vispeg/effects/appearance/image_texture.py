"""Image texture: an image on a part. The part's colour turns white as `amount` grows, so the image keeps its colours.

`pick` is the image's place in the sorted list of images (see `vispeg.effects.common.images`), from 0 (first) to 1
(last), so the same world works with a folder of any size. Native mechanism: `tex_data`, `mat_texrepeat`, `mat_rgba`.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.appearance import PartLook, blend, pixels, where_nonzero
from vispeg.effects.common.images import PICTURES, picked, picture


class ImageTexture(PartLook):
    """Image texture on a part."""

    name = "image_texture"
    images = PICTURES
    order = 60
    params = {
        "amount": Param(0.0, 0.0, 1.0, "1", start=1.0, doc="share of the image; the rest is nominal"),
        "pick": Param(0.0, 0.0, 1.0, "1", start=0.0, shape=True, doc="place in the sorted list of images"),
        "size": Param(0.25, 0.02, 3.0, "m", start=0.25, shape=True, scale="log", doc="edge of the image on the part"),
        "turns": Param(0.0, 0.0, 4.0, "1", start=0.0, shape=True, doc="quarter turns of the image, rounded down"),
    }
    writes = frozenset({"tex_data", "mat_texrepeat", "mat_rgba"})

    def write(self, fields, p):
        for row, column, part in where_nonzero(self.targets(fields.scene), p["amount"]):
            value = {name: float(v[row, column]) for name, v in p.items()}
            texture = pixels(fields, row, part)
            image = picture(picked(PICTURES, value["pick"]), len(texture))
            texture[:] = blend(texture, np.rot90(image, int(value["turns"])), value["amount"])
            m = fields.model.material(part).id
            rgb = fields["mat_rgba"][row, m, :3]
            rgb += value["amount"] * (1 - rgb)
            fields["mat_texrepeat"][row, m] = 1 / value["size"]
