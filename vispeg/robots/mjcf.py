"""Read a user's MJCF as an arm: keep its bodies, joints and shapes, not how its own scene drives and simulates them."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.notes import note
from vispeg.formats.guard import is_file
from vispeg.robots.arm import REFUSALS, compiled
from vispeg.robots.resources import check_resources

AROUND = ("gravity", "wind", "density", "viscosity")  # options that describe what is around the arm


def read_mjcf(path: Path) -> tuple[mujoco.MjSpec, dict[str, tuple[float, float]]]:
    """Return the arm as a spec without actuators, and {joint: (torque limit in N m, inf)} from the removed actuators.

    Damping, armature and friction of the file are kept. Flags and settings of its solver are not, since they would
    switch effects off; nor is its gravity compensation, which a recording's controller states. Missing meshes, height
    fields and textures are dropped; geoms of missing meshes and height fields are dropped too.

    Raises:
        UserError: the file is refused by `check_resources` or by MuJoCo, or the mass of a body that moves depends on a
            missing mesh.
    """
    check_resources(path)
    try:
        spec = mujoco.MjSpec.from_file(str(path))
    except REFUSALS as error:
        raise UserError(f"MuJoCo cannot read it: {error}", file=path) from error
    # the sizes in the file are for its own scene
    spec.memory, spec.nuserdata, spec.nkey, spec.njmax, spec.nconmax = -1, 0, 0, -1, -1
    _drop_missing(spec, path)
    _reset_options(spec)
    _drop_compensation(spec, path)
    limits = _limits(spec, path)
    for group in (spec.actuators, spec.sensors, spec.keys):  # they depend on elements that are replaced
        for element in list(group):
            spec.delete(element)
    return spec, limits


def _reset_options(spec: mujoco.MjSpec) -> None:
    """Set all options but those of `AROUND` to MuJoCo's defaults; gravity that is disabled is zero."""
    option, usual = spec.option, mujoco.MjSpec().option
    if option.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY:
        option.gravity = np.zeros(3)
    for name in (n for n in dir(usual) if not n.startswith("_") and n not in AROUND):
        setattr(option, name, getattr(usual, name))


def _drop_compensation(spec: mujoco.MjSpec, path: Path) -> None:
    """Set `gravcomp` of all bodies to 0; a note names those whose weight the file compensates."""
    compensated = [body for body in spec.bodies if body.gravcomp]
    for body in compensated:
        body.gravcomp = 0.0
    if compensated:
        what = "gravcomp is left out, as the controller of a recording states whether weight is compensated"
        note(f"{path}: {what}: {', '.join(body.name or 'a body without a name' for body in compensated)}")


def _drop_missing(spec: mujoco.MjSpec, path: Path) -> None:
    """Delete meshes, height fields, skins and textures whose file is missing, and the geoms that use them."""
    base = path.resolve().parent
    folder = spec.meshdir
    meshes = {m.name or Path(m.file).stem: m for m in spec.meshes if _missing(spec, base, folder, m.file)}
    fields = {h.name or Path(h.file).stem: h for h in spec.hfields if _missing(spec, base, folder, h.file)}
    for geom in list(spec.geoms):
        if geom.meshname in meshes or geom.hfieldname in fields:
            body = geom.parent
            weighs = not body.explicitinertial and geom.mass != 0.0 and geom.density != 0.0
            if weighs and (_moves(body) or spec.compiler.settotalmass > 0):  # a share of a total depends on each mass
                file = meshes[geom.meshname].file if geom.meshname in meshes else fields[geom.hfieldname].file
                raise UserError(
                    f"the mass of body '{body.name}' comes from a mesh that is missing ({file})",
                    file=path,
                    expected="the mesh, or an <inertial> in the body",
                )
            spec.delete(geom)
    for element in [*meshes.values(), *fields.values()]:
        spec.delete(element)
    for skin in [s for s in spec.skins if _missing(spec, base, folder, s.file)]:
        spec.delete(skin)
    for texture in list(spec.textures):
        files = [texture.file, *texture.cubefiles]
        if any(_missing(spec, base, spec.texturedir, f) for f in files):
            for material in spec.materials:
                material.textures = ["" if t == texture.name else t for t in material.textures]
            spec.delete(texture)


def _moves(body: mujoco.MjsBody) -> bool:
    """Return whether a joint moves the body."""
    return body.name != "world" and (bool(body.joints) or _moves(body.parent))


def _missing(spec: mujoco.MjSpec, base: Path, folder: str, file: str) -> bool:
    return bool(file) and not (is_file(base / folder / file) or file in spec.assets)


def _limits(spec: mujoco.MjSpec, path: Path) -> dict[str, tuple[float, float]]:
    """Return by joint the torque limit, N m, and inf for the speed.

    The limit is the least of what the joint's actuators can give and the joint's own `actuatorfrcrange`.
    """
    model = compiled(spec, str(path))
    limits: dict[str, float] = {}
    for i in range(model.njnt):
        if model.jnt_actfrclimited[i]:
            limits[model.joint(i).name] = float(abs(model.jnt_actfrcrange[i]).max())
    for i in range(model.nu):
        if model.actuator_trntype[i] != mujoco.mjtTrn.mjTRN_JOINT:
            continue
        force = abs(model.actuator_forcerange[i]).max() if model.actuator_forcelimited[i] else float("inf")
        motor = model.actuator_biastype[i] == mujoco.mjtBias.mjBIAS_NONE
        if model.actuator_ctrllimited[i] and motor:  # force = gain * ctrl
            force = min(force, abs(model.actuator_ctrlrange[i]).max() * abs(model.actuator_gainprm[i, 0]))
        name = model.joint(int(model.actuator_trnid[i, 0])).name
        torque = float(force) * abs(float(model.actuator_gear[i, 0]))
        limits[name] = min(limits.get(name, float("inf")), torque)
    return {name: (torque, float("inf")) for name, torque in limits.items()}
