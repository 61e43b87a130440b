"""Images with known content, for the camera's effects."""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import effect
from vispeg.core.frame import Frame
from vispeg.core.seeds import stream

F, SIZE = 60.0, 64  # px
K = np.array([[F, 0, 31.5], [0, F, 31.5], [0, 0, 1.0]])


def plane(z: float, n: int = 1, size: int = SIZE) -> Frame:
    """Images (n of them) of a plane at z m, all grey."""
    depth = np.full((n, size, size), z, np.float32)
    return Frame(rgb=np.full((n, size, size, 3), 0.5, np.float32), depth=depth, K=np.repeat(K[None], n, 0))


def step(near: float, far: float, columns: slice = slice(24, 40)) -> Frame:
    """Return depth images of a post at `near` m over these columns, before a plane at `far` m."""
    frame = plane(far)
    frame.depth[:, :, columns] = near
    return frame


def busy(n: int = 3, shape: tuple[int, int] = (61, 64)) -> Frame:
    """Return frames with slopes, an edge, a corner without readings, and black, white and coloured pixels."""
    rng = stream(0, "busy")
    v, u = np.mgrid[: shape[0], : shape[1]]
    z = (0.3 + 0.004 * v + 0.001 * u).astype(np.float32)
    z[15:35, 20:35], z[:6, :6] = 0.12, 0.0
    rgb = rng.random((n, *shape, 3), dtype=np.float32)
    rgb[:, 40:44], rgb[:, 50:52] = 0.0, 1.0
    depth = np.stack([z * (1 + 0.05 * i) for i in range(n)]).astype(np.float32)
    velocity = np.tile([0.1, -0.05, 0.02, 0.1, 0.2, 0.0], (n, 1))
    return Frame(rgb=rgb, depth=depth, K=np.repeat(K[None], n, 0), velocity=velocity, time=np.zeros(n))


def apply(name: str, frame: Frame, *, state: dict | None = None, draw: int = 0, **values: float) -> Frame:
    """Apply one effect to a frame in place and return it; magnitudes not given are at null, shapes at their start."""
    kind = effect(name)
    full = {k: values.get(k, q.start if q.shape else q.null) for k, q in kind.params.items()}
    assert set(values) <= set(full)
    p = {k: np.full(frame.n, float(v)) for k, v in full.items()}
    frame.truth = frame.depth.copy() if frame.truth is None and frame.depth is not None else frame.truth
    kind.image({} if state is None else state, frame, p, [stream(draw, name, i) for i in range(frame.n)])
    return frame
