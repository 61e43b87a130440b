"""A free object on a table as the rest of the project sees it: an MJCF with one body that nothing holds.

Its shapes are heard alone in its contacts (MuJoCo's geom priority): what an effect says of the object is what its
contacts do, whatever the table's own numbers are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import mujoco

from vispeg.core.errors import UserError
from vispeg.formats.format import enrol
from vispeg.formats.guard import is_file
from vispeg.robots.arm import REFUSALS
from vispeg.robots.resources import check_resources

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
    """A rigid body that flies, lands and slides.

    Attributes:
        name: of its body.
        source: the file.
        free: places of effects on it: its name.
        joints, links: those of an arm: none.
        flange: none.
    """

    name: str
    source: str
    build: Callable[[], mujoco.MjSpec] = field(repr=False)
    joints: tuple[str, ...] = ()
    links: tuple[str, ...] = ()
    flange: str = ""

    @property
    def free(self) -> tuple[str, ...]:
        """Where effects of contact can act."""
        return (self.name,)

    def compile(self, step: float) -> mujoco.MjModel:
        """Give the model with a physics step in s."""
        spec = self.build()
        spec.option.timestep = step
        return spec.compile()


def is_object(source: str | Path) -> bool:
    """Whether a file is an MJCF with a free body and no other joint; False where it cannot be read."""
    path = Path(source)
    if path.suffix.lower() not in SUFFIXES or not is_file(path):
        return False
    try:
        check_resources(path)
        joints = mujoco.MjSpec.from_file(str(path.expanduser())).joints
    except (UserError, *REFUSALS):
        return False
    return len(joints) == 1 and joints[0].type == FREE


def _example(folder: Path) -> Path:
    (folder / "cube.xml").write_text(CUBE, encoding="utf-8")
    return folder / "cube.xml"


@enrol("MJCF of an object", _example)
def load_object(source: str | Path) -> ObjectModel:
    """Give the object of an MJCF file.

    Raises:
        UserError: unreadable, no free body or more than one, other joints, or a body without a name, mass or shape.
    """
    path = Path(source).expanduser()
    if not is_file(path):
        raise UserError("no such file", file=path, expected="an MJCF (.xml) of one free body")
    check_resources(path)
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        model = spec.compile()
    except REFUSALS as error:
        raise UserError(f"MuJoCo cannot read it: {error}", file=path) from error
    joints = spec.joints
    if len(joints) != 1 or joints[0].type != FREE:
        raise UserError(
            "is not a free object", file=path, expected="one body with a freejoint", got=f"{len(joints)} joints"
        )
    body = joints[0].parent
    if not body.name:
        raise UserError("the free body has no name", file=path, expected="a name, which recordings refer to")
    shapes = [geom for geom in body.geoms if geom.contype or geom.conaffinity]
    if not shapes or model.body(body.name).mass[0] <= 0:
        raise UserError(f"body '{body.name}' can touch nothing", file=path, expected="a collision shape and a mass")
    most = max((geom.priority for geom in spec.geoms), default=0)
    for geom in shapes:
        geom.priority = most + 1
    for group in (spec.sensors, spec.keys, spec.actuators):
        for element in list(group):
            spec.delete(element)
    return ObjectModel(body.name, str(path.resolve()), spec.copy)
