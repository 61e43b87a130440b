"""An arm whose file has no shapes is drawn from its joints."""

import mujoco
import numpy as np
import pytest

from vispeg.core.seeds import stream
from vispeg.report.live.shapes import skeleton
from vispeg.robots.model import load
from vispeg.sim.compiled import compiled


def bare(rng, joints=6):
    """A URDF of a chain with origins and axes at random, and no shapes."""
    links = "".join(
        f'<link name="l{i}"><inertial><mass value="1"/><inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/>'
        "</inertial></link>"
        for i in range(joints + 1)
    )
    text = ""
    for i in range(joints):
        at = [" ".join(f"{x:.4f}" for x in rng.uniform(-0.3, 0.3, 3)) for _ in range(2)]
        text += f'<joint name="panda_joint{i + 1}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/>'
        text += f'<origin xyz="{at[0]}" rpy="{at[1]}"/><axis xyz="0 0 1"/>'
        text += '<limit lower="-2" upper="2" velocity="2" effort="50"/></joint>'
    return f'<robot name="bare">{links}{text}</robot>'


@pytest.mark.parametrize("seed", range(3))
def test_links_without_shapes_reach_from_joint_to_joint(tmp_path, seed):
    (tmp_path / "bare.urdf").write_text(bare(stream(seed, "bare")))
    model = compiled(load(tmp_path / "bare.urdf"))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    drawn = skeleton(model)
    moving = [int(b) for b in model.jnt_bodyid]
    assert {body for body, _, _ in drawn} == set(moving)
    radius = min(float(np.linalg.norm(v, axis=1).min()) for _, v, _ in drawn)
    for parent, child in zip(moving[:-1], moving[1:], strict=True):
        vertices = next(v for body, v, _ in drawn if body == parent)
        ends = data.xmat[parent].reshape(3, 3).T @ (data.xpos[child] - data.xpos[parent])
        for end in (np.zeros(3), ends):  # round caps about both joints
            assert np.linalg.norm(vertices - end, axis=1).min() == pytest.approx(radius, rel=0.02)


def test_links_with_shapes_get_none():
    assert not skeleton(compiled(load("iiwa14")))
