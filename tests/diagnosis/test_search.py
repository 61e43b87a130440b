"""Where the search looks when the joints that lack most torque hold nothing it can name."""

import numpy as np
import pytest
from loops import ARM, drive, recorded

import vispeg.diagnosis.selection.search as searching
from vispeg.core.effect import EffectInstance
from vispeg.core.seeds import stream
from vispeg.diagnosis.run import diagnose
from vispeg.robots.model import load
from vispeg.worlds.world import World


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """A shoulder with dry friction, on three motions of both joints."""
    path = tmp_path_factory.mktemp("arm") / "arm.xml"
    path.write_text(ARM)
    robot, world, out = load(path), World().add(EffectInstance.of("coulomb_friction", "shoulder", torque=0.8)), []
    for i in range(3):
        t = np.arange(600) * 5e-3
        swing = 1 - np.cos(2 * np.pi * np.outer(t, [0.7 + 0.2 * i, 1.1 - 0.2 * i]))
        s = drive(robot, "position", 0.0, command=0.4 * swing, seconds=3.0, rate=200.0, kp=60.0, kd=4.0)
        out.append(recorded(robot, robot.source, world, s, stream(5, i)))
    return out


@pytest.mark.parametrize("suspected", ["shoulder", "elbow"])
def test_joints_that_are_not_suspected_are_looked_at_before_the_search_gives_up(recordings, monkeypatch, suspected):
    monkeypatch.setattr(searching, "suspects", lambda lacks, joints: [suspected])
    world = World(recordings[0].robot)
    record = diagnose(world, recordings[:2], recordings[2:], nthread=1, plan_next=False).record
    assert [(e["effect"], e["where"]) for e in record["effects"]] == [("coulomb_friction", "shoulder")]
