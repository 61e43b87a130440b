"""An arm whose file has no shapes is drawn from its joints."""

import mujoco
import numpy as np
import pytest
from bare_arm import bare

from vispeg.core.seeds import stream
from vispeg.report.live.arm import arm_arrays, picked, stage
from vispeg.report.live.shapes import skeleton
from vispeg.robots.model import load
from vispeg.sim.compiled import compiled
from vispeg.worlds.world import World


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


def test_a_report_draws_them_too(tmp_path):
    (tmp_path / "bare.urdf").write_text(bare(stream(0, "bare")))
    world = World(load(tmp_path / "bare.urdf").source)
    model = compiled(load(world.robot))
    arm = arm_arrays(world, [model.joint(j).name for j in range(model.njnt)])
    assert set(arm["arm/body"]) == {int(b) for b in model.jnt_bodyid} and stage(picked(arm))["parts"]


def test_links_with_shapes_get_none():
    assert not skeleton(compiled(load("iiwa14")))
