"""Export a model with its effects as MJCF or URDF, as `vispeg export MODEL` does."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import mujoco

from vispeg.api.export.ending import check_ending
from vispeg.api.export.urdf import Urdf, to_urdf
from vispeg.api.inputs import read_model
from vispeg.core.errors import UserError
from vispeg.core.files import write_files_atomic
from vispeg.core.marker import apart
from vispeg.core.notes import note
from vispeg.core.paths import expanded
from vispeg.render.cameras import model_camera
from vispeg.render.cameras.standard import standard_cameras
from vispeg.report.text.summary import Block, Line, Summarised
from vispeg.robots.scene import Scene
from vispeg.sim.export import Exported, to_mjcf
from vispeg.task.belief import model_cell
from vispeg.worlds.world import World


@dataclass(frozen=True)
class ExportedModel(Summarised):
    """A model exported to a file.

    Attributes:
        file: the MJCF or URDF.
        to: the file's format.
        robot: the model's robot.
        meshes: files of meshes, height fields, skins and textures beside it.
        native: labels of the effects in the file.
        left_out: labels of the effects that the format has no element for.
        rotors: joint -> rotor inertia, kg m2, which a URDF cannot hold.
        lacking: what else of the model a URDF cannot hold.
    """

    file: Path
    to: Literal["mjcf", "urdf"]
    robot: str
    meshes: Sequence[str]
    native: Sequence[str]
    left_out: Sequence[str]
    rotors: Mapping[str, float] = field(default_factory=dict)
    lacking: Sequence[str] = ()

    @property
    def record(self) -> dict[str, object]:
        """The output of `vispeg export --json`."""
        rotors = {"rotor_inertia": dict(self.rotors)} if self.rotors else {}
        effects = {"native": [*self.native], "left_out": [*self.left_out]}
        lacking = {"lacking": [*self.lacking]} if self.lacking else {}
        return {self.to: str(self.file), "meshes": [*self.meshes], **effects, **rotors, **lacking}

    @property
    def summary(self) -> list[Block]:
        """The file, the effects in it, and those left out."""
        program = "MuJoCo" if self.to == "mjcf" else "URDF"
        lines = [f"{self.file}: {self.robot}, {len(self.meshes)} meshes and textures beside it"]
        lines += [f"in it: {label}" for label in self.native]
        lines += [f"not in it, {program} has no element for it: {label}" for label in self.left_out]
        lacking = [f"rotor inertia of {', '.join(self.rotors)}"] if self.rotors else []
        if lacking := [*lacking, *self.lacking]:
            lines.append(f"not in it, URDF has no element for it: {'; '.join(lacking)}")
        return [Line(text, path=True) for text in lines]


def _whole(world: World, meshes: str) -> Exported:
    """Return the MJCF of a model, or of its cell with the task's physics time step if it has one."""
    if world.cell is None:
        return to_mjcf(world, meshes)
    belief = model_cell(world)
    config, scene = belief.config, with_cameras(belief.scene)
    step = config.control_period / config.substeps
    return to_mjcf(belief.world.add(*world.effects), meshes, scene, step)


def with_cameras(scene: Scene) -> Scene:
    """Return a cell whose MuJoCo spec includes its standard cameras."""

    def build() -> mujoco.MjSpec:
        spec = scene.spec()
        model_camera.add_complete(spec, standard_cameras(scene.tip, scene.target))
        return spec

    return replace(scene, build=build)


def export_model(
    model: str | Path | World, out: str | Path, to: Literal["mjcf", "urdf"], *, overwrite: bool = False
) -> ExportedModel:
    """Write a model with its effects; meshes and textures are copied beside the file.

    An MJCF of a cell has arm, tool, held part, fixture, table and cameras. A URDF has only the arm.

    Args:
        model: a world, a model file, a robot's name, or a path to an MJCF or URDF.
        out: the file to write, .xml or .urdf.
        to: the format.
        overwrite: replace `out` if it exists.

    Raises:
        UserError: no such model, a model that the format cannot hold, a wrong file ending, or `out` exists.
    """
    path = expanded(out)
    check_ending(path, to)
    world = model if isinstance(model, World) else read_model(str(model))
    apart(path, (world.robot,) if isinstance(model, World) else (model, world.robot))
    mesh_folder = f"{path.stem}-meshes"
    exported = _whole(world, mesh_folder) if to == "mjcf" else to_urdf(world, mesh_folder)
    meshes = {path.parent / name: content for name, content in exported.meshes.items()}
    if path.exists() and not overwrite:
        raise UserError("exists already; name another or pass --overwrite", file=path)
    write_files_atomic({**meshes, path: exported.xml.encode()}, overwrite=overwrite)
    if isinstance(exported, Urdf) and not exported.collides:
        note(f"{world.robot}: no shape of the model collides, so the URDF has no <collision>")
    native, left_out = ([e.label for e in effects] for effects in (exported.native, exported.left_out))
    more = {} if isinstance(exported, Exported) else {"rotors": exported.rotors, "lacking": exported.lacking}
    return ExportedModel(path, to, world.robot, [*exported.meshes], native, left_out, **more)
