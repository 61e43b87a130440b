"""An arm of fewer joints than a pose has degrees of freedom."""

import pytest

from vispeg.core.errors import UserError
from vispeg.task.world_file import load_world

ARM = """<mujoco><compiler angle="radian"/><worldbody><body name="base">
<geom type="cylinder" size=".08 .05" mass="5"/>
<body name="l1" pos="0 0 .1"><joint name="j1" axis="0 0 1" range="-2.8 2.8"/>
<geom type="capsule" fromto="0 0 0 0 0 .3" size=".05" mass="3"/>
<body name="l2" pos="0 0 .3"><joint name="j2" axis="0 1 0" range="-2 2"/>
<geom type="capsule" fromto="0 0 0 .35 0 0" size=".04" mass="2"/>
<body name="l3" pos=".35 0 0"><joint name="j3" axis="0 1 0" range="-2.5 2.5"/>
<geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass="1"/><site name="flange" pos=".32 0 0"/>
</body></body></body></body></worldbody></mujoco>
"""


def test_a_world_of_it_is_refused_with_one_line(tmp_path):
    """It cannot hold a tool at any pose: no numerical failure, and the number of joints is named."""
    (tmp_path / "arm.xml").write_text(ARM)
    world = "format: vispeg-world/1\nname: three\nrobot: {model: arm.xml, velocity_limit: [2, 2, 2]}\n"
    (tmp_path / "three.yaml").write_text(world)
    with pytest.raises(UserError, match="expected six joints or more, or robot.home; got '3 joints'"):
        load_world(tmp_path / "three.yaml")
