"""A MuJoCo model in the page's 3D view: a frame a body, its shapes in it; a posture moves the frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from vispeg.report.live.shapes import colour_of, shape_of, visible

if TYPE_CHECKING:
    import viser

G = mujoco.mjtGeom


@dataclass(frozen=True)
class Look:
    """Of all shapes at once, in place of their own colour (0 to 255): a ghost of a model beside the measured one."""

    colour: tuple[int, int, int] | None = None
    opacity: float | None = None


class Drawing:
    """A model under `root` of the scene.

    Args:
        scene: of the page.
        root: name of the frame that holds it, such as `/arm`.
        model: compiled.
        look: of its shapes.
        colours: geom name -> colour (3,) 0 to 1, in place of the model's.
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
        for g in visible(model):
            body, name = int(model.geom_bodyid[g]), model.geom(g).name
            shape = shape_of(model, g)
            if shape is None:
                continue
            if body not in self.frames:
                self.frames[body] = scene.add_frame(f"{root}/body{body}", show_axes=False)
            override = (colours or {}).get(name)
            colour = look.colour or np.round(255 * np.asarray(override or colour_of(model, g))).astype(int)
            scene.add_mesh_simple(
                f"{root}/body{body}/geom{g}",
                *shape,
                color=colour,
                opacity=look.opacity,
                flat_shading=model.geom_type[g] in (G.mjGEOM_BOX, G.mjGEOM_MESH) and len(shape[1]) < 200,
                side="double",
                position=model.geom_pos[g],
                wxyz=model.geom_quat[g],
            )
        self.pose(model.qpos0)

    def pose(self, qpos: np.ndarray, bodies: Mapping[str, np.ndarray] | None = None) -> None:
        """Moves it to the configuration (nq,), with bodies placed in their parents as a Snapshot says."""
        for name, place in (bodies or {}).items():
            body = self.model.body(name).id
            self.model.body_pos[body], self.model.body_quat[body] = place[:3], place[3:]
        self.data.qpos[:] = np.nan_to_num(qpos)
        mujoco.mj_kinematics(self.model, self.data)
        for body, frame in self.frames.items():
            frame.position, frame.wxyz = self.data.xpos[body].copy(), self.data.xquat[body].copy()

    def show(self, visible: bool) -> None:
        """Whether it can be seen."""
        self.root.visible = visible

    def remove(self) -> None:
        """Takes it away."""
        self.root.remove()
