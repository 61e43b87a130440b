"""Close-up picture of a cell at one moment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import numpy as np

from vispeg.core.errors import UserError
from vispeg.recordings.recording import Recording
from vispeg.render.backends.backend import BackendName, Renderer
from vispeg.render.cameras.camera import Camera, looking_at
from vispeg.render.cameras.standard import focal_of
from vispeg.robots.scene import Scene
from vispeg.task.belief import recorded_cell

WIDTH, HEIGHT, FOV = 640, 420, 30.0  # px; vertical field of view in degrees
TOWARDS = (0.0, 0.0, 0.03)  # m, point at which the camera looks, relative to the goal's mouth
FROM = (0.33, -0.42, 0.22)  # m, camera position relative to that point


def draw(scene: Scene, q: np.ndarray, backend: BackendName = "auto") -> bytes:
    """Return the picture as PNG.

    Args:
        scene: the cell.
        q: (nj,) joint angles, rad.
        backend: renderer.

    Raises:
        UserError: no renderer that works here.
    """
    seen = np.array(scene.target) + TOWARDS
    eye = seen + np.array(FROM)
    focal, turned = focal_of(FOV, HEIGHT), looking_at(eye, seen, np.array([0.0, 0.0, 1.0]))
    at = (float(eye[0]), float(eye[1]), float(eye[2]))
    camera = Camera("cell", WIDTH, HEIGHT, focal, focal, (WIDTH - 1) / 2, (HEIGHT - 1) / 2, pos=at, quat=turned)
    with Renderer(scene, [camera], backend, shadows=True) as renderer:
        shot = renderer.render(np.concatenate([q, np.zeros(renderer.model.nq - len(q))]))["cell"]
    return cv2.imencode(".png", shot.rgb[:, :, ::-1])[1].tobytes()


def worst_moment(arrays: Mapping[str, np.ndarray], recordings: Sequence[Recording]) -> dict[str, np.ndarray]:
    """Return a picture of the moment in `worst/q` as entry of `evidence.npz`; empty if no renderer works."""
    named = [r for r in recordings if str(arrays["worst/recording"]).startswith(r.name)]  # also `rig-1` for rig-10
    rec = max(named, key=lambda r: len(r.name), default=recordings[0])
    try:
        png = draw(recorded_cell(rec).scene, np.nan_to_num(arrays["worst/q"]))
    except UserError:  # no renderer here: the page has no picture
        return {}
    return {"worst/png": np.frombuffer(png, np.uint8)}
