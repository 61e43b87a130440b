"""A tactile image: a gel pad with a camera behind it, as a kind of image of its own."""

from pathlib import Path

import numpy as np

import vispeg
from vispeg.render.image_kinds import ImageKind, enrol

FACE, THICK = 0.010, 0.003  # m from the camera to the gel's outer face, and the gel's thickness
PAD = """format: vispeg-world/1
name: pad
base: randomized
task: {cameras: [pad]}
cameras:
  pad: {parent: flange, pos: [0.0165, 0.0, 0.165], quat: [0.5, 0.5, -0.5, -0.5], fx: 40.0, fy: 40.0}
"""


def pressed(frame):
    """Return the pressed share of the gel, (n, 1, H, W), from depth as rendered, (n, H, W) in m, 0 = nothing there."""
    depth = np.where(frame.truth > 0, frame.truth, np.inf)[:, None]
    return np.clip((FACE - depth) / THICK, 0, 1).astype(np.float32)


def grey(image):
    """Return (H, W, 3) uint8 for people, of (1, H, W)."""
    return np.repeat(np.rint(255 * image[0]).astype(np.uint8)[..., None], 3, axis=-1)


def packed(image):
    """Return the bytes of a replay."""
    return np.rint(255 * image).astype(np.uint8)


def unpacked(stored):
    """Return the image of the bytes."""
    return stored.astype(np.float32) / 255


enrol(ImageKind("touch", 1, np.float32, 1.0, "share", pressed, np.uint8, packed, unpacked, grey), "touch")
Path("pad.yaml").write_text(PAD)
env = vispeg.make("pad.yaml", obs_mode="touch")
touch = env.reset(seed=1)[0]["touch_pad"]
print(touch.shape, f"{touch.max():.1f}")  # (1, 48, 48) 0.5
