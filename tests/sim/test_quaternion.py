"""The flange's orientation and Jacobian: MuJoCo's own conversion and its own Jacobian are the oracles."""

import mujoco
import numpy as np
import pytest

from vispeg.core.seeds import stream
from vispeg.robots.model import load
from vispeg.sim.nominal import Nominal

TURNED = """
<mujoco><worldbody><body name="base">
<body name="a" pos="0 0 0.3"><joint name="j1" axis="0 0 1"/><geom size="0.1"/>
<body name="b" pos="0.2 0 0.1"><joint name="j2" axis="0 1 0"/><geom size="0.1"/>
<site name="flange" pos="0.1 0.2 0.3" quat="0.5 -0.7 0.1 0.4"/></body>
<body name="c" pos="-0.2 0 0"><joint name="j3" axis="1 0 0"/><geom size="0.1"/></body></body></body>
</worldbody></mujoco>
"""


@pytest.mark.parametrize("arm", ["iiwa14", "turned"])
def test_agrees_with_mujoco(arm):
    """Many poses, among them half turns where the real part vanishes; a turned flange; a joint off the flange's way."""
    robot = load("iiwa14", "meg50") if arm == "iiwa14" else None
    model = robot.compile() if robot else mujoco.MjModel.from_xml_string(TURNED)
    joints = robot.joints if robot else ("j1", "j2", "j3")
    q = stream(0, "poses").uniform(-3, 3, (300, len(joints)))
    q[:40] = np.pi / 2 * np.round(q[:40] * 2 / np.pi)
    nominal = Nominal(model, joints, "flange", len(q), 1)
    mass, jac, pos, rot, gravity = nominal.operational(q)
    data, site = mujoco.MjData(model), model.site("flange").id
    for i, angles in enumerate(q):
        data.qpos[:] = angles
        mujoco.mj_forward(model, data)
        quat, full = np.empty(4), np.empty((model.nv, model.nv))
        jacp, jacr = np.empty((3, model.nv)), np.empty((3, model.nv))
        mujoco.mju_mat2Quat(quat, data.site_xmat[site])
        mujoco.mj_jacSite(model, data, jacp, jacr, site)
        mujoco.mj_fullM(model, data, full)
        side = (
            np.sign(quat @ rot[i]) if np.ptp(np.sort(np.abs(quat))[-2:]) < 1e-9 or np.abs(quat[0] - 0.5) < 1e-9 else 1.0
        )
        np.testing.assert_allclose(side * rot[i], quat, atol=1e-14)
        np.testing.assert_allclose(jac[i], np.concatenate([jacp, jacr]), atol=1e-13)
        np.testing.assert_allclose(mass[i], full, atol=1e-13)
        np.testing.assert_allclose(gravity[i], data.qfrc_bias, atol=1e-12)
        np.testing.assert_array_equal(pos[i], data.site_xpos[site])
