"""Image texture: a picture on a part, in its own colours: the part's colour goes to white as the picture comes.

The image is the one at `pick` (0 to 1) of the sorted list of images (`vispeg.effects.common.images` says where from),
so the same world works with a folder of any size. Native mechanism: `tex_data`, `mat_texrepeat`, `mat_rgba`.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.appearance import PartLook, at, blend, pixels
from vispeg.effects.common.images import PICTURES, picked, picture


class ImageTexture(PartLook):
    """Image texture on a part."""

    name = "image_texture"
    order = 60
    params = {
        "amount": Param(0.0, 0.0, 1.0, "1", start=1.0, doc="of the image over the part's own look"),
        "pick": Param(0.0, 0.0, 1.0, "1", start=0.0, shape=True, doc="which image: share of the sorted list"),
        "size": Param(0.25, 0.02, 3.0, "m", start=0.25, shape=True, scale="log", doc="edge of the image on the part"),
        "turns": Param(0.0, 0.0, 4.0, "1", start=0.0, shape=True, doc="quarter turns of the image, cut"),
    }
    writes = frozenset({"tex_data", "mat_texrepeat", "mat_rgba"})

    def write(self, fields, p):
        for row, column, part in at(self.targets(fields.scene), p["amount"]):
            value = {name: float(v[row, column]) for name, v in p.items()}
            texture = pixels(fields, row, part)
            image = picture(picked(PICTURES, value["pick"]), len(texture))
            texture[:] = blend(texture, np.rot90(image, int(value["turns"])), value["amount"])
            m = fields.model.material(part).id
            rgb = fields["mat_rgba"][row, m, :3]
            rgb += value["amount"] * (1 - rgb)
            fields["mat_texrepeat"][row, m] = 1 / value["size"]
