"""JPEG: the image is compressed and decompressed at quality `100 - loss`, as for network cameras and bag files.

Source: ITU-T T.81, with libjpeg's scale of quality. Range: quality 60 to 95.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.params import Param
from vispeg.effects.common.camera import CameraEffect


class Jpeg(CameraEffect):
    """JPEG compression artefacts."""

    name = "jpeg"
    order = 70
    params = {"loss": Param(0.0, 0.0, 95.0, "1", start=20.0, doc="100 minus the quality; 0 is no compression")}

    def image(self, state, frame, p, rng):
        import cv2

        if frame.rgb is None:
            return
        for row in self.rows(p):
            quality = int(round(100 - float(p["loss"][row])))
            image = (frame.rgb[row] * np.float32(255) + np.float32(0.5)).astype(np.uint8)
            _, code = cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, quality])
            back = np.asarray(cv2.imdecode(code, cv2.IMREAD_COLOR))[..., ::-1]
            np.multiply(back, np.float32(1 / 255), out=frame.rgb[row])
