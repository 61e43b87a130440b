"""Two states of one robot: what both have is the arm, what one has is the change, named with its size."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from loops import ARM, SWING, WEIGHT, pendulum

import vispeg
from vispeg.core.effect import EffectInstance
from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.diagnosis.change import diagnose_change
from vispeg.identify.inverse import TorqueEvidence
from vispeg.recordings.recording import Control, Recording
from vispeg.worlds.world import World

EMPTY = (
    EffectInstance.of("coulomb_friction", "shoulder", torque=0.4),
    EffectInstance.of("coulomb_friction", "elbow", torque=0.3),
    EffectInstance.of("link_mass", "upper", mass=0.5),
)
LOAD = EffectInstance.of("payload", "flange", mass=0.6, z=-0.02)


@pytest.fixture(scope="module")
def states(tmp_path_factory):
    """Three torque recordings of the empty arm and three of the loaded one, each on motions of its own."""
    path = tmp_path_factory.mktemp("arm") / "arm.xml"
    path.write_text(ARM)
    out = []
    for i, effects in enumerate([EMPTY] * 3 + [(*EMPTY, LOAD)] * 3):
        t, w = np.arange(1600) * 5e-3, 1 + 0.1 * i
        q = np.stack([0.6 * np.sin(2.5 * w * t) + 0.3 * np.sin(6 * t), 0.8 * np.sin(4 * w * t + i)], axis=1)
        rec = Recording(path, str(path), ("shoulder", "elbow"), 200.0, Control("unknown", 200.0), t, q, tau=0 * q)
        rec = replace(rec, torque_sensor="motor", noise={"tau": 0.02})
        ideal, tau = TorqueEvidence([rec]), np.zeros_like(q)
        tau[ideal.items[0].segment.rows] = ideal.simulated([World().add(*effects)])[0][0]
        out.append(replace(rec, tau=tau + 0.02 * stream(i, "tau").standard_normal(q.shape)))
    return out[:3], out[3:]


def test_a_payload_is_the_change_and_friction_is_the_arm(states):
    empty, loaded = states
    world = World(empty[0].robot)
    found = diagnose_change(world, empty, loaded[:2], loaded[2:], nthread=1, plan_next=False)
    arm = {(e["effect"], e["where"]) for e in found.record["baseline"]["effects"]}
    assert {(e.effect, e.where) for e in EMPTY[:2]} <= arm and ("payload", "flange") not in arm
    (change,) = found.record["effects"]
    names = [change, *change["indistinguishable_from"]]
    assert ("payload", "flange") in {(e["effect"], e["where"]) for e in names}
    if change["effect"] == "payload":
        assert change["params"]["mass"]["value"] == pytest.approx(0.6, rel=0.15)
    assert {(e.effect, e.where) for e in found.world.effects} > arm
    assert found.record["ladder"][-1]["heldout_error"] < 1.2 * 0.02


def test_a_baseline_needs_a_recording_to_judge_on(states):
    empty, loaded = states
    with pytest.raises(UserError, match="another must judge"):
        diagnose_change(World(empty[0].robot), empty[:1], loaded[:2], loaded[2:])


def test_a_change_keeps_what_joints_do_not_show_and_states_all_inputs():
    """A pendulum that is as its model says, before and after; its model also has effects that cameras alone see."""
    robot, t, recordings = pendulum(), np.arange(1600) * 5e-3, []
    for i, name in enumerate(["d", "b", "c", "a"]):
        w = 2.0 + 0.4 * i
        q = 0.8 * np.sin(w * t)[:, None]
        tau = -SWING * w**2 * q + WEIGHT * np.sin(q) + 0.02 * stream(i, "pendulum").standard_normal(q.shape)
        rec = Recording(Path(name), robot.source, robot.joints, 200.0, Control("unknown", 200.0), t, q, tau=tau)
        recordings.append(replace(rec, torque_sensor="motor", noise={"tau": 0.02}))
    world = World(robot.source).add(
        EffectInstance.of("brightness", "external", change=0.2), EffectInstance.of("background", "all")
    )
    found = vispeg.diagnose(world, recordings[2], recordings[3], baseline=recordings[:2], threads=1)
    assert found.verdict == "adequate" and found.world.effects == world.effects
    assert list(found.record["provenance"]["inputs"]) == ["a", "b", "c", "d"]
