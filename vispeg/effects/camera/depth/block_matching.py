"""Block matching: depth is computed by stereo matching instead of taken from the renderer.

A second camera is rendered beside the first, a dot pattern is projected on the scene from between them, and semi-global
matching finds the disparities. The effect shares no formula with the other depth effects, so worlds with it are an
independent test of them. `vispeg.render.block_matching` does the work, since a hook on images cannot render. Source:
Hirschmueller, Stereo processing by semiglobal matching and mutual information, TPAMI 30(2), 2008.
"""

from __future__ import annotations

from vispeg.core.params import Param, seed_param
from vispeg.effects.common.camera import CameraEffect


class BlockMatching(CameraEffect):
    """Depth from stereo matching of two rendered images."""

    name = "block_matching"
    smooth = False
    params = {
        "on": Param(0.0, 0.0, 1.0, "1", start=1.0, doc="1: depth is matched, not rendered"),
        "baseline": Param(
            0.05, 0.005, 0.3, "m", start=0.05, shape=True, doc="distance to the second camera, on the right"
        ),
        "focal": Param(
            210.0,
            50.0,
            1000.0,
            "px",
            start=210.0,
            shape=True,
            doc="focal length of the matched images, to the nearest whole multiple of the delivered one's",
        ),
        "nearest": Param(0.1, 0.04, 0.5, "m", start=0.1, shape=True, doc="depth of the largest disparity searched"),
        "window": Param(5.0, 1.0, 15.0, "px", start=5.0, shape=True, doc="side of the matched blocks"),
        "pattern": Param(0.6, 0.0, 1.0, "1", start=0.6, shape=True, doc="contrast of the projected dots"),
        "noise": Param(0.01, 0.0, 0.1, "1", start=0.01, shape=True, doc="sd of the images' read-out noise"),
        "seed": seed_param("picks the dot pattern"),
    }
