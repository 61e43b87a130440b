"""A recording with an error of its own does not pull the values away from what the others say."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from loops import ARM, drive, recorded

from vispeg.core.effect import EffectInstance
from vispeg.core.seeds import stream
from vispeg.diagnosis.evidence.roles import shown
from vispeg.diagnosis.run import diagnose
from vispeg.diagnosis.selection.judge import Judge
from vispeg.diagnosis.selection.search import Search
from vispeg.identify.evidence import Evidence
from vispeg.identify.fit import fit_job
from vispeg.identify.pool import run_together
from vispeg.robots.model import load
from vispeg.worlds.world import World

FRICTION = EffectInstance.of("viscous_friction", "shoulder", damping=1.2)
LATE = 0.04  # s


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """Five swings of an arm with friction; the goals of the fourth were logged too early."""
    path = tmp_path_factory.mktemp("arm") / "arm.xml"
    path.write_text(ARM)
    robot, out = load(path), []
    t = np.arange(500) * 5e-3
    for i in range(5):
        size, pace = 0.3 + 0.05 * i, np.array([0.7 + 0.1 * i, 1.1 - 0.1 * i])  # rad, Hz
        meant, done = (size * (1 - np.cos(2 * np.pi * np.outer(np.maximum(t - x, 0.0), pace))) for x in (0.0, LATE))
        command = done if i == 3 else meant
        s = drive(robot, "position", 0.0, command=command, seconds=2.5, rate=200.0, kp=60.0, kd=4.0)
        swing = recorded(robot, robot.source, World().add(FRICTION), s, stream(5, i))
        out.append(replace(swing, q_cmd=meant, path=Path(f"swing-{i}")))
    return out


def test_a_right_model_weighs_all_alike_and_a_wrong_one_keeps_its_error(recordings):
    """Weights change what a residual counts, and no error that is reported; asked twice, they stay."""
    evidence, world = Evidence([*recordings[:3], recordings[4]]), World(recordings[0].robot)
    right = world.add(FRICTION)
    assert evidence.weigh(evidence.residuals([right])[0]).min() > 0.9, "noise alone"
    errors, pieces = evidence.errors([world, right]), shown(evidence, world)
    before = evidence.residuals([world])[0]
    factor = evidence.weigh(before)
    np.testing.assert_allclose(evidence.residuals([world])[0], before * factor, rtol=1e-12)
    np.testing.assert_allclose(evidence.weigh(before * factor), 1.0, rtol=1e-12)
    assert evidence.errors([world, right]) == pytest.approx(errors, rel=1e-12)
    assert shown(evidence, world) == pytest.approx(pieces, rel=1e-12)
    assert evidence.floor == pytest.approx(Evidence(evidence.recordings).floor, rel=1e-12)


def test_a_recording_whose_clock_is_off_does_not_move_the_value(recordings):
    """Least squares alone takes the delay for friction; the search counts that recording like the others."""
    world = World(recordings[0].robot)
    evidence, judged = Evidence(recordings[:4]), Evidence(recordings[4:])
    start = world.add(EffectInstance.of("viscous_friction", "shoulder", damping=0.3))
    (plain,) = run_together([fit_job(Evidence(recordings[:4]), start, [0])], evidence.residuals)
    state = Search(evidence, Judge(judged)).run(world)
    found = {e.label: e.params for e in state.world.effects}["viscous_friction(shoulder)"]["damping"].value
    off = abs(plain.world.effects[0].params["damping"].value - 1.2)
    assert abs(found - 1.2) < 0.3 * off
    record = diagnose(world, recordings[:4], recordings[4:], nthread=1, plan_next=False).record
    assert any("described far worse" in note and recordings[3].name in note for note in record["notes"])
