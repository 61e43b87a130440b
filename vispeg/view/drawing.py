"""Draw a MuJoCo model in the page's 3D view: one frame per body, which holds its shapes and moves with the posture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from vispeg.report.live.shapes import BARE, colour_of, shape_of, skeleton, visible

if TYPE_CHECKING:
    import viser

G = mujoco.mjtGeom


@dataclass(frozen=True)
class Look:
    """One colour (0 to 255) and opacity for all shapes, in place of their own: for a ghost beside the measured arm."""

    colour: tuple[int, int, int] | None = None
    opacity: float | None = None


class Drawing:
    """Draw a model in the frame `root` of the scene.

    Args:
        scene: the page's 3D scene.
        root: name of the frame to draw in, such as `/arm`.
        model: the compiled model.
        look: colour and opacity of all shapes.
        colours: geom name -> colour (3,), 0 to 1, in place of the model's.
    """

    def __init__(
        self,
        scene: viser.SceneApi,
        root: str,
        model: mujoco.MjModel,
        look: Look = Look(),
        colours: dict[str, tuple[float, float, float]] | None = None,
    ):
        self.model, self.data = model, mujoco.MjData(model)
        self.root = scene.add_frame(root, show_axes=False)
        self.frames: dict[int, Any] = {}
        self.scene, self.name = scene, root
        for g in visible(model):
            shape = shape_of(model, g)
            if shape is None:
                continue
            override = (colours or {}).get(model.geom(g).name)
            colour = look.colour or np.round(255 * np.asarray(override or colour_of(model, g))).astype(int)
            flat = model.geom_type[g] in (G.mjGEOM_BOX, G.mjGEOM_MESH) and len(shape[1]) < 200
            at = {"position": model.geom_pos[g], "wxyz": model.geom_quat[g]}
            self._add(int(model.geom_bodyid[g]), f"geom{g}", shape, colour, look, flat_shading=flat, **at)
        for k, (body, vertices, faces) in enumerate(skeleton(model)):
            self._add(body, f"link{k}", (vertices, faces), look.colour or BARE[k % 2], look)
        self.pose(model.qpos0)

    def _add(
        self, body: int, name: str, shape: tuple[np.ndarray, np.ndarray], colour: Any, look: Look, **at: Any
    ) -> None:
        """Add triangles to a body's frame."""
        if body not in self.frames:
            self.frames[body] = self.scene.add_frame(f"{self.name}/body{body}", show_axes=False)
        path = f"{self.name}/body{body}/{name}"
        self.scene.add_mesh_simple(path, *shape, color=colour, opacity=look.opacity, side="double", **at)

    def pose(self, qpos: np.ndarray, bodies: Mapping[str, np.ndarray] | None = None) -> None:
        """Move the model to the configuration (nq,), and bodies to poses (7,) in their parents: m, then w x y z."""
        for name, place in (bodies or {}).items():
            body = self.model.body(name).id
            self.model.body_pos[body], self.model.body_quat[body] = place[:3], place[3:]
        self.data.qpos[:] = np.nan_to_num(qpos)
        mujoco.mj_kinematics(self.model, self.data)
        for body, frame in self.frames.items():
            frame.position, frame.wxyz = self.data.xpos[body].copy(), self.data.xquat[body].copy()

    def show(self, visible: bool) -> None:
        """Show or hide the drawing."""
        self.root.visible = visible

    def remove(self) -> None:
        """Remove the drawing."""
        self.root.remove()
