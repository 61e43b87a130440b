"""A free object on a table: an MJCF with one free body.

The object's shapes have a higher geom priority in MuJoCo than the table. So the object alone determines the parameters
of its contacts, and an effect on the object acts in full whatever the table's parameters are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import mujoco
import numpy as np

from vispeg.core.counts import count
from vispeg.core.errors import UserError
from vispeg.core.paths import expanded
from vispeg.formats.format import enrol
from vispeg.formats.guard import is_file
from vispeg.robots.arm import REFUSALS
from vispeg.robots.resources import check_resources, forget_meshes

FREE = mujoco.mjtJoint.mjJNT_FREE
SUFFIXES = (".xml", ".mjcf")
CUBE = """<mujoco model="cube">
  <worldbody>
    <geom name="table" type="plane" size="1 1 0.1"/>
    <body name="cube" pos="0 0 0.1">
      <freejoint/>
      <geom type="box" size="0.05 0.05 0.05" mass="0.4" friction="0.5"/>
    </body>
  </worldbody>
</mujoco>
"""


@dataclass(frozen=True, eq=False)
class ObjectModel:
    """A free rigid body, with the attributes that effects expect of a robot.

    Attributes:
        name: name of the body.
        source: path of the file.
        build: function that returns a new MjSpec.
        joints, links: empty, as there is no arm.
        flange: empty.
    """

    name: str
    source: str
    build: Callable[[], mujoco.MjSpec] = field(repr=False)
    joints: tuple[str, ...] = ()
    links: tuple[str, ...] = ()
    flange: str = ""

    @property
    def free(self) -> tuple[str, ...]:
        """Places where contact effects can act: the body's name."""
        return (self.name,)

    def compile(self, step: float) -> mujoco.MjModel:
        """Compile the model with physics step `step`, s."""
        spec = self.build()
        spec.option.timestep = step
        return spec.compile()


def is_object(source: str | Path) -> bool:
    """Return whether a file is an MJCF with a free body and no other joint; False if it cannot be read."""
    path = Path(source)
    if path.suffix.lower() not in SUFFIXES or not is_file(path):
        return False
    try:
        check_resources(path)
        joints = mujoco.MjSpec.from_file(str(expanded(path))).joints
    except (UserError, *REFUSALS):
        return False
    return len(joints) == 1 and joints[0].type == FREE


def _example(folder: Path) -> Path:
    (folder / "cube.xml").write_text(CUBE, encoding="utf-8")
    return folder / "cube.xml"


@enrol("MJCF of an object", _example)
def load_object(source: str | Path) -> ObjectModel:
    """Load the free object in an MJCF file.

    Raises:
        UserError: the file cannot be read, does not have exactly one joint, which is free, the body lacks a name, a
            mass or a collision shape, MuJoCo cannot fuse it with bodies fixed to it, a shape has an impossible
            `solref`, or a contact pair or `override` rules.
    """
    path = expanded(source)
    if not is_file(path):
        raise UserError("no such file", file=path, expected="an MJCF (.xml) of one free body")
    check_resources(path)
    forget_meshes()
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        spec.compiler.fusestatic = True  # bodies fixed to each other become one, on all of which effects act
        for group in (spec.sensors, spec.keys, spec.actuators):
            for element in list(group):
                spec.delete(element)
        model = spec.compile()
    except REFUSALS as error:
        raise UserError(f"MuJoCo cannot read it: {error}", file=path) from error
    joints = spec.joints
    if len(joints) != 1 or joints[0].type != FREE:
        raise UserError(
            "is not a free object", file=path, expected="one body with a freejoint", got=count(len(joints), "joint")
        )
    body = joints[0].parent
    if not body.name:
        raise UserError("the free body has no name", file=path, expected="a name, which recordings refer to")
    apart = [model.body(i).name for i in np.flatnonzero(model.body_rootid == model.body(body.name).id)[1:]]
    if apart:
        expected = f"bodies that MuJoCo can fuse with '{body.name}' (see fusestatic in its manual)"
        raise UserError("the object has parts that stay bodies of their own", file=path, expected=expected, got=apart)
    shapes = [geom for geom in body.find_all("geom") if geom.contype or geom.conaffinity]
    if not shapes or model.body(body.name).mass[0] <= 0:
        raise UserError(
            f"body '{body.name}' lacks a shape or a mass", file=path, expected="a collision shape and a mass"
        )
    _check_rules(spec, body, path)
    for geom in shapes:
        _check_solref(geom, path)
    highest = max((geom.priority for geom in spec.geoms), default=0)
    for geom in shapes:
        geom.priority = highest + 1
    return ObjectModel(body.name, str(path.resolve()), spec.copy)


def _check_rules(spec: mujoco.MjSpec, body: mujoco.MjsBody, path: Path) -> None:
    """Check that nothing replaces the contact parameters of the body's geoms, which contact effects change."""
    expected = "friction, solref and solimp at the body's geoms alone"
    if spec.option.enableflags & mujoco.mjtEnableBit.mjENBL_OVERRIDE:
        raise UserError("replaces the parameters of all contacts", file=path, key="override", expected=expected)
    of_body = {geom.name for geom in body.find_all("geom")} - {""}
    for pair in spec.pairs:
        names = pair.geomname1, pair.geomname2
        if of_body & set(names):
            between = " and ".join(f"'{name}'" for name in names)
            raise UserError(f"replaces the contact between {between}", file=path, key="pair", expected=expected)


def _check_solref(geom: mujoco.MjsGeom, path: Path) -> None:
    """Check that a geom's `solref` is in one form and has a stiffness. MuJoCo replaces mixed forms by its default."""
    first, second = (float(v) for v in geom.solref)
    if not (min(first, second) > 0 or first < 0 and second <= 0):
        name = f"'{geom.name}'" if geom.name else f"of body '{geom.parent.name}'"
        raise UserError(
            f"impossible contact of geom {name}",
            file=path,
            key="solref",
            expected="time constant > 0 and damping ratio > 0, or -stiffness < 0 and -damping <= 0",
            got=f"{first:g} {second:g}",
        )
