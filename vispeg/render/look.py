"""Apply the look of a sampled world to a renderer: colours, textures, lights, background objects, camera geometry.

Every look starts from the renderer's original fields and from its own episode's poses of bodies, so that nothing of the
previous look remains.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from vispeg.core.effect import OPTICAL, Effect, EffectInstance, effect
from vispeg.core.errors import UserError
from vispeg.render.backends.backend import Renderer
from vispeg.render.backends.pristine import place
from vispeg.render.cameras import model_camera
from vispeg.render.cameras.camera import Camera
from vispeg.worlds.places import ALL, values
from vispeg.worlds.world import World


class Fields:
    """The fields of a renderer's model in the form that an effect's `write` takes: a batch of one simulation.

    `fields[name]` is a view of shape (1, ...) of an array of MjModel. Dotted names such as `vis.headlight.ambient`
    reach below the top level. Cameras are the model's `cam_*` rows, in MuJoCo's axes.

    Attributes:
        model: the renderer's own model; writing to a view changes it.
        scene: the Scene of the model, with the names of parts, lights and cameras.
        robot: the same Scene, under the name that effects of the physics use.
    """

    def __init__(self, model: mujoco.MjModel, scene: Any):
        self.model, self.scene, self.robot = model, scene, scene

    def __getitem__(self, name: str) -> np.ndarray:
        return place(self.model, name)[None]


def dress(
    renderer: Renderer, scene: Any, world: World, bodies: Mapping[str, Sequence[float] | np.ndarray] | None = None
) -> list[int]:
    """Apply a world's looks to a renderer: effects of the family `appearance`, and camera effects that move a camera.

    Bodies are placed first, because a look may depend on them: distractors keep away from the fixture.

    Args:
        renderer: the renderer; it must be made from a Scene if the world has camera effects.
        scene: the scene that has the effects' targets.
        world: the sampled world.
        bodies: poses of bodies in this episode, as for `Renderer.render`; all others keep their poses of the model.

    Returns:
        Ids of the textures that were uploaded to the driver because their pixels changed.

    Raises:
        UserError: the scene lacks the place of an effect, or the renderer's model has no row for the camera of a camera
            effect.
    """
    renderer.pristine.restore(renderer.model)
    renderer.move(bodies or {})
    rows = _rows(renderer)
    for i, camera in rows.values():
        model_camera.write(renderer.model, i, camera)
    before = {name: _pose_and_intrinsics(renderer.model, i) for name, (i, _) in rows.items()}
    fields = Fields(renderer.model, scene)
    for writer, placed in writers(world):
        if writer.family == "camera":
            _need_rows(renderer, placed)
        writer.write(fields, values(writer, [placed], scene))
    aimed = []  # a camera that no effect moved stays as it is, bit for bit
    for camera in renderer.nominal:
        i, _ = rows.get(camera.name, (None, None))
        same = i is None or np.array_equal(before[camera.name], _pose_and_intrinsics(renderer.model, i))
        aimed.append(camera if same or i is None else model_camera.read(renderer.model, i, camera))
    renderer.aim(aimed)
    return renderer.refresh()


def writers(world: World) -> list[tuple[Effect, list[EffectInstance]]]:
    """Return the effects of a world that write a look, each with all its instances, in the order in which they act."""
    placed_by: dict[str, list[EffectInstance]] = {}
    for placed in world.effects:
        kind = effect(placed.effect)
        if kind.family in OPTICAL and kind.overrides("write"):
            placed_by.setdefault(placed.effect, []).append(placed)
    return sorted(((effect(name), at) for name, at in placed_by.items()), key=lambda e: (e[0].order, e[0].name))


def _rows(renderer: Renderer) -> dict[str, tuple[int, Camera]]:
    """Return by name the row in the model, and the camera as placed, of each camera that has a row."""
    pairs = ((c, model_camera.row_of(renderer.model, c)) for c in renderer.nominal)
    return {c.name: (i, c) for c, i in pairs if i is not None}


def _pose_and_intrinsics(model: mujoco.MjModel, i: int) -> np.ndarray:
    return np.concatenate([model.cam_pos[i], model.cam_quat[i], model.cam_intrinsic[i]])


def _need_rows(renderer: Renderer, placed: Sequence[EffectInstance]) -> None:
    """Raise UserError if an effect acts on a camera that has no row in the model."""
    names = [renderer.model.camera(i).name for i in range(renderer.model.ncam)]
    for at in placed:
        if at.where != ALL and at.where not in names:
            what = "a renderer made from the Scene, with that camera"
            raise UserError(f"{at.effect} moves a camera that is not there", expected=what, got=at.where, choices=names)
