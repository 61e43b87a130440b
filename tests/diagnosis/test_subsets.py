"""What a reader sees when effects are switched off: the errors and residuals of worlds without them."""

import numpy as np
import pytest
from loops import drive, recorded

from vispeg.core.effect import EffectInstance
from vispeg.core.seeds import stream
from vispeg.diagnosis.conclusion.subsets import EVERY, choices, subsets
from vispeg.identify.inverse import evidence_for
from vispeg.robots.model import load
from vispeg.worlds.world import World

ARM = """
<mujoco><worldbody><body name="base">
  <body name="upper"><joint name="shoulder" axis="0 1 0"/>
    <inertial pos="0 0 -0.2" mass="2" diaginertia="0.02 0.02 0.02"/>
    <body name="lower" pos="0 0 -0.4"><joint name="elbow" axis="0 1 0"/>
      <inertial pos="0 0 -0.15" mass="1" diaginertia="0.01 0.01 0.01"/>
      <site name="flange" pos="0 0 -0.3"/></body></body></body></worldbody></mujoco>
"""
FRICTION = EffectInstance.of("coulomb_friction", "shoulder", torque=0.8)
DAMPING = EffectInstance.of("viscous_friction", "elbow", damping=0.6)


@pytest.mark.parametrize("count", range(9))
def test_choices_begin_with_none_end_with_all_and_never_repeat(count):
    on = choices(count)
    assert on.shape[1] == count and not on[0].any() and on[-1].all()
    assert len({tuple(row) for row in on}) == len(on)
    assert len(on) == (2**count if count <= EVERY else 2 * count)
    if count > EVERY:  # the ladder, and all but one: each effect can be switched off from all
        assert (
            all((on.sum(axis=1) == k).any() for k in range(count + 1)) and (on.sum(axis=1) == count - 1).sum() == count
        )


@pytest.fixture(scope="module")
def judged(tmp_path_factory):
    """The evidence of a 6 s swing of an arm with both effects."""
    path = tmp_path_factory.mktemp("arm") / "arm.xml"
    path.write_text(ARM)
    robot, t = load(path), np.arange(1200) * 5e-3
    swing = 0.4 * (1 - np.cos(2 * np.pi * np.outer(t, [0.7, 1.1])))
    s = drive(robot, "position", 0.0, command=swing, seconds=6.0, rate=200.0, kp=60.0, kd=4.0)
    recording = recorded(robot, robot.source, World().add(FRICTION, DAMPING), s, stream(5, "subsets"))
    return evidence_for([recording], 1)


def test_every_choice_has_the_error_and_the_residual_of_its_world(judged):
    base = World(judged.items[0].recording.robot)
    rival = base.add(EffectInstance.of("coulomb_friction", "elbow", torque=0.2))
    arrays = {
        k.removeprefix("choice/"): v for k, v in subsets(judged, base.add(FRICTION, DAMPING), 0, [("r", rival)]).items()
    }
    assert arrays["on"].tolist() == [[0, 0], [1, 0], [0, 1], [1, 1], [0, 0]] and arrays["rival"].tolist() == [
        ""
    ] * 4 + ["r"]
    worlds = [base, base.add(FRICTION), base.add(DAMPING), base.add(FRICTION, DAMPING), rival]
    item = judged.items[0]
    for i, world in enumerate(worlds):
        residual = judged.residuals([world])[0]
        assert arrays["error"][i] == judged.rms_error(residual)
        gap = np.where(item.valid, item.measured - judged.simulated([world])[0][0], np.nan)[:, : item.nj]
        np.testing.assert_allclose(arrays["joints"][i], np.sqrt(np.nanmean(gap**2, axis=0)))
        drawn = arrays["0/residual"][i]
        assert len(drawn) == len(arrays["0/time"]) <= 700 < len(gap)
        np.testing.assert_allclose(np.nanmax(drawn, axis=0), np.nanmax(gap, axis=0), rtol=1e-6)  # no peak is lost
        np.testing.assert_allclose(np.nanmin(drawn, axis=0), np.nanmin(gap, axis=0), rtol=1e-6)
    assert arrays["error"][3] < 0.2 * min(arrays["error"][:3]), "the truth is better than any part of it"
