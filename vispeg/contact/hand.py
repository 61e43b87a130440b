"""The hand: everything beyond the wrist's force sensor, and what it touches, without the arm.

The arm is replaced by a flange with six joints, `hand_x` to `hand_rz`, in a frame set for each batch row: three
slides along its axes, then three hinges (intrinsic x, y, z). Each has a spring and a damper towards a path (`ctrl`:
six goals, then six rates); their force is the correction. So effects of the arm cannot influence a contact verdict,
nor vice versa.
"""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np

from vispeg.core.rules import RULES
from vispeg.robots import furniture
from vispeg.robots.scene import Scene

AXES = ("x", "y", "z", "rx", "ry", "rz")
FRAME = "hand"  # the body that stands for the flange
PRIORITY = 2  # priority of the goal's pieces over what is held, see `vispeg.contact.pieces`
MARK = "attached-"  # MuJoCo needs a prefix for elements attached from another spec
COPIED = ("name", "type", "size", "pos", "quat", "contype", "conaffinity", "condim", "priority", "friction")
COPIED += ("solmix", "solref", "solimp", "margin", "gap")
MASS, INERTIA = 0.8, 0.02  # kg, kg m^2: of a hand, for critical damping
LEVER = 0.1  # m: torques count as forces at this distance, and angles as displacements
UNITS = np.repeat([1.0, LEVER], 3)  # N and N m of a wrench whose components are alike


def stiffness() -> np.ndarray:
    """Return the stiffness (6,) N/m, N m/rad of the springs that hold the hand to the measured path.

    It is the error of a force, which a sensor's zero makes, over that of a place, as closely as an arm repeats it.
    """
    return RULES.zero / (RULES.repeats * RULES.kinematics_place) * UNITS**2


def hand(scene: Scene) -> Scene:
    """Return the scene without its arm, held by springs; effects find their places as in the scene."""
    return replace(scene, joints=(), links=(), flange="flange", base=FRAME, build=lambda: _spec(scene))


def _spec(scene: Scene) -> mujoco.MjSpec:
    source, spec = scene.spec(), mujoco.MjSpec()
    furniture.options(spec)
    spec.option.gravity = source.option.gravity
    body = spec.worldbody.add_body(name=FRAME)
    for i, axis in enumerate(AXES):
        kind = mujoco.mjtJoint.mjJNT_SLIDE if i < 3 else mujoco.mjtJoint.mjJNT_HINGE
        body.add_joint(name=f"hand_{axis}", type=kind, axis=np.eye(3)[i % 3])
    body.mass, body.inertia, body.explicitinertial = 1e-3, (1e-6,) * 3, True
    body.add_site(name="flange", group=4)
    tool = source.body("tool")
    tool.pos, tool.quat = (0, 0, 0), (1, 0, 0, 0)
    body.add_frame().attach_body(tool, MARK, "")
    spec.worldbody.add_frame().attach_body(source.body(scene.fixture), MARK, "")
    for sensor in list(spec.sensors):  # the wrench is the hand's input
        spec.delete(sensor)
    for group in (spec.bodies, spec.joints, spec.geoms, spec.sites):
        for element in group:
            element.name = element.name.removeprefix(MARK)
    for geom in source.worldbody.geoms:
        if geom.contype or geom.conaffinity:
            _copied(spec, geom)
    # unless a part other than the held one has a priority, and so contact parameters, of its own
    if all(g.priority < 1 or g.parent.name == scene.held for g in spec.geoms):
        for geom in spec.geoms:
            if geom.name == scene.top or (scene.config.shape == "round" and geom.name.startswith(scene.wall)):
                geom.priority = PRIORITY
    springs = stiffness()
    gains = {"stiffness": springs, "damping": 2 * np.sqrt(springs * np.repeat([MASS, INERTIA], 3))}
    for kind, values in gains.items():
        for axis, gain in zip(AXES, values.tolist(), strict=True):
            _spring(spec, axis, kind, gain)
    return spec


def _copied(spec: mujoco.MjSpec, geom: mujoco.MjsGeom) -> None:
    """Add a copy of a geom of the world body, such as the table's, with all that affects contact."""
    spec.worldbody.add_geom(**{k: getattr(geom, k) for k in COPIED})


def _spring(spec: mujoco.MjSpec, axis: str, kind: str, gain: float) -> None:
    """Add a motor of force `gain (goal - now)`, for position or rate."""
    motor = spec.add_actuator(name=f"{kind}_{axis}", target=f"hand_{axis}", trntype=mujoco.mjtTrn.mjTRN_JOINT)
    motor.gaintype, motor.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
    motor.gainprm[0], motor.biasprm[1 if kind == "stiffness" else 2] = gain, -gain
