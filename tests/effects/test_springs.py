"""Springs of the fixture and the peg, and what the gripper weighs, against closed form."""

from __future__ import annotations

import numpy as np
import pytest
from clamped import CLAMP, SCENE, G, pose, written

from vispeg.core.effect import EffectInstance
from vispeg.worlds.world import World

COMPLIANCE = 3e-5


def loaded(name: str, where: str, body: str, axis: str, compliance: float, load: float) -> float:
    """Displacement of the spring along `axis`, m or rad, once a constant force or torque on the body has settled."""
    plain, soft = World(), World().add(EffectInstance.of(name, where, **{axis: compliance}))
    batch, _ = written([plain, soft])
    batch.expand("opt.timestep")[:] = 1e-3
    batch.expand("dof_armature")[:, :7] = CLAMP
    batch.expand("opt.tolerance")[:] = 0.0
    batch.bind("qpos")[:, :7] = pose(0.63, 0.0, 0.2)
    joint = batch.model.joint(f"{'peg_grasp' if body == 'peg' else body}_{axis}")
    at = int(joint.qposadr[0])
    applied, qpos = batch.bind("qfrc_applied"), batch.bind("qpos")
    batch.step(nstep=1500)
    rest = qpos[:, at].copy()  # a peg's weight hangs on its springs too
    applied[:, int(joint.dofadr[0])] = load
    batch.step(nstep=1500)
    moved = qpos[:, at] - rest
    assert abs(moved[0]) < 1.1e-4 * abs(load) * (1.0 if axis in ("roll", "pitch") else 1e-2), "absent springs hold"
    return float(moved[1])


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_a_fixture_gives_way_by_force_times_compliance(axis):
    moved = loaded("fixture_compliance", "fixture", "fixture", axis, COMPLIANCE, 20.0)
    assert moved == pytest.approx(20.0 * COMPLIANCE, rel=1e-3)


@pytest.mark.parametrize("axis", ["roll", "pitch"])
def test_a_fixture_rocks_by_torque_times_compliance(axis):
    moved = loaded("fixture_compliance", "fixture", "fixture", axis, 1e-3, 2.0)
    assert moved == pytest.approx(2e-3, rel=1e-3)


@pytest.mark.parametrize(("axis", "compliance", "load"), [("x", 2e-5, 10.0), ("y", 2e-5, 10.0), ("roll", 2e-3, 0.5)])
def test_a_peg_gives_way_between_the_fingers(axis, compliance, load):
    moved = loaded("peg_grasp_compliance", "peg", "peg", axis, compliance, load)
    assert moved == pytest.approx(load * compliance, rel=2e-2)


def test_the_wrist_feels_what_the_gripper_weighs_and_where_it_balances():
    """At rest: 9.81 N more for a kg, and a torque of the tool's weight times the shift; a payload is not felt."""
    worlds = [
        World(),
        World().add(EffectInstance.of("tool_mass", "gripper", mass=0.2)),
        World().add(EffectInstance.of("tool_com", "gripper", x=0.02)),
        World().add(EffectInstance.of("payload", "flange", mass=1.0)),
    ]
    batch, _ = written(worlds)
    batch.expand("opt.timestep")[:] = 1e-3
    batch.expand("dof_armature")[:, :7] = CLAMP
    batch.expand("opt.tolerance")[:] = 0.0
    batch.bind("qpos")[:, :7] = pose(0.63, 0.0, 0.2)
    wrench = batch.bind("sensordata")
    batch.step(nstep=800)
    more = wrench[:, :6] - wrench[0, :6]
    tool = SCENE.compile().body("tool").mass[0]
    assert np.linalg.norm(more[1, :3]) == pytest.approx(0.2 * G, rel=2e-3)
    assert np.linalg.norm(more[2, :3]) < 1e-3
    assert np.linalg.norm(more[2, 3:]) == pytest.approx(tool * G * 0.02, rel=5e-3)
    np.testing.assert_allclose(more[3], 0.0, atol=1e-2)
