"""Environment: surroundings from a Radiance .hdr panorama, which shows as the sky and colours the ambient light.

The panorama is tone-mapped into the skybox texture `sky`. `light` moves the colour of `vis.headlight.ambient` towards
that of the mean light from above (cosine-weighted, as a level surface receives it); its brightness stays. The
renderer Filament draws no ambient light, so `light` changes nothing there.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.appearance import SceneLook, blend, pixels
from vispeg.effects.common.images import ENVIRONMENTS, environment, picked
from vispeg.effects.common.light import LUMA
from vispeg.effects.common.panorama import directions, log_mean, look_up, tone_mapped


class Environment(SceneLook):
    """Surroundings and ambient colour from an HDR panorama."""

    name = "environment"
    images = ENVIRONMENTS
    order = 60
    params = {
        "amount": Param(0.0, 0.0, 1.0, "1", start=1.0, doc="share of the panorama in the sky; the rest is nominal"),
        "light": Param(0.0, 0.0, 1.0, "1", start=0.5, doc="share of the panorama's colour in the ambient light"),
        "pick": Param(
            0.0,
            0.0,
            2.0,
            "1",
            start=0.0,
            shape=True,
            doc="place in the sorted list of panoramas, 0 to 1; in that for training, 1 to 2",
        ),
        "turn": Param(0.0, -np.pi, np.pi, "rad", start=0.0, shape=True, doc="rotation about the vertical"),
        "exposure": Param(0.0, -3.0, 3.0, "1", start=0.0, shape=True, doc="exposure of the panorama, stops"),
    }
    writes = frozenset({"tex_data", "vis.headlight.ambient"})

    def write(self, fields, p):
        value = {name: v[:, 0] for name, v in p.items()}
        for row in np.flatnonzero((value["amount"] != 0) | (value["light"] != 0)):
            pick = float(value["pick"][row])
            panorama = environment(picked(ENVIRONMENTS, pick - 1 if pick > 1 else pick, training=pick > 1))
            if value["amount"][row]:
                texture = pixels(fields, int(row), "sky")
                radiance = look_up(panorama, directions(texture.shape[1]), float(value["turn"][row]))
                image = tone_mapped(radiance, float(value["exposure"][row]), log_mean(panorama))
                texture[:] = blend(texture, image, float(value["amount"][row]))
            if value["light"][row]:
                ambient = fields["vis.headlight.ambient"][row]
                colour = received(panorama) ** (1 / 2.2)  # MuJoCo's renderer multiplies encoded colours
                tinted = ambient @ LUMA / max(colour @ LUMA, 1e-9) * colour
                ambient[:] = np.minimum((1 - value["light"][row]) * ambient + value["light"][row] * tinted, 1)


def received(panorama: np.ndarray) -> np.ndarray:
    """Return the light (3,) on a level surface: the panorama's upper half, weighted by cos(zenith) and solid angle."""
    rows = len(panorama) // 2
    zenith = (np.arange(rows) + 0.5) / len(panorama) * np.pi
    weight = np.cos(zenith) * np.sin(zenith)
    mean = (weight[:, None] * panorama[:rows].mean(axis=1)).sum(axis=0) / weight.sum()
    return np.maximum(mean, 1e-6 * max(float(mean.max()), 1e-12))
