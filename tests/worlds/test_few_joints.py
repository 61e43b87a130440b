"""An arm of fewer joints than a pose has degrees of freedom."""

import pytest

from vispeg.cli.main import main
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


@pytest.mark.parametrize("home", ["", ", home: [0, 0.8, 1]"])
def test_a_world_of_it_is_refused_with_one_line(home, tmp_path):
    """It cannot hold a tool at any pose, a posture of its own changes nothing: commands that take it are named."""
    (tmp_path / "arm.xml").write_text(ARM)
    robot = f"{{model: arm.xml, velocity_limit: [2, 2, 2]{home}}}"
    (tmp_path / "three.yaml").write_text(f"format: vispeg-world/1\nname: three\nrobot: {robot}\n")
    with pytest.raises(UserError, match="six joints or more; record, compare.* the arm's own file.*got '3 joints'"):
        load_world(tmp_path / "three.yaml")


@pytest.mark.slow
def test_what_the_refusal_offers_works(tmp_path):
    """The arm's own file is recorded, and compared with what was recorded."""
    (tmp_path / "arm.xml").write_text(ARM)
    arm = ["--quiet", "--out"]
    argv = ["record", str(tmp_path / "arm.xml"), "--motion", "fourier", "--duration", "4", *arm, str(tmp_path / "rig")]
    assert main(argv) == 0
    assert (
        main(["compare", str(tmp_path / "arm.xml"), "--recording", str(tmp_path / "rig"), *arm, str(tmp_path / "c")])
        == 0
    )
