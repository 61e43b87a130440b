"""Noise that an OSC loop feeds back: encoder noise and the motion that it causes make up the right model's error."""

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.rules import RULES
from vispeg.core.seeds import stream
from vispeg.diagnosis.selection.judge import Judge
from vispeg.identify.calibrate import calibrate
from vispeg.identify.evidence import Evidence
from vispeg.identify.excitation import motion
from vispeg.identify.loops.noise_motion import _begun, noise_motion, reading_noise, within_noise
from vispeg.identify.record import centre_of, controller, record
from vispeg.recordings.recording import Recording
from vispeg.report.fitted import fit_record
from vispeg.robots.model import load
from vispeg.sim.compiled import compiled
from vispeg.sim.rollout import ReadingNoise, simulate
from vispeg.worlds.places import values
from vispeg.worlds.world import World

NOISE = {"q": 2e-5, "dq": 1e-3, "tau": 0.2}


NOMINAL = World()


def recorded(mode: Literal["position", "torque", "osc"], world: World = NOMINAL, seed: int = 5) -> Recording:
    """3 s of the nominal arm, noise added after the loop."""
    robot = load("iiwa14")
    control = controller(robot, mode, 500.0, centre_of(robot))
    more = {"model": compiled(robot)} if mode == "osc" else {}
    path = motion("osc" if mode == "osc" else "fourier", robot, 500.0, 3.0, stream(seed, "stirred test"), **more)
    return record(world, path, control, NOISE, stream(seed + 1, "stirred test"))


def test_the_right_models_error_is_foretold():
    """Over six draws of fed-back noise: most residuals lie under 1 + `noise_motion`, and not far under."""
    evidence = Evidence([recorded("osc")])
    more, item, one = noise_motion(evidence, World()), evidence.items[0], np.ones((6, 7))
    noise = ReadingNoise(NOISE["q"] * one, NOISE["dq"] * one, stream(7, "stirred test"))
    moved = simulate(item.robot, [World()] * 6, [item.segment], h_max=5e-4, reading_noise=noise)[0].q
    moved += NOISE["q"] * stream(8, "stirred test").standard_normal(moved.shape)
    clean, valid = evidence.simulated([World()])[0][0], item.valid[:, :7]
    torque = np.sum(((item.measured - clean) / item.sigma)[:, 7:] ** 2 * item.valid[:, 7:])
    angle = np.sum(((moved - clean[:, :7]) / item.sigma[:7]) ** 2 * valid, axis=(1, 2))
    residual = (angle + torque) / evidence.count
    assert more > 0.3
    assert np.sum(residual > 1 + more) <= 2
    assert np.median(residual) > 1 + 0.2 * more


def test_it_follows_from_the_noise():
    """Variance goes with the square of the velocity noise; joint servos are left alone."""
    rec = recorded("osc")
    once, twice = (noise_motion(Evidence([replace(rec, noise={**NOISE, "dq": f * 1e-3})]), World()) for f in (1, 2))
    assert twice == pytest.approx(4 * once, rel=0.1)
    assert noise_motion(Evidence([recorded("position")]), World()) == 0.0


@pytest.mark.slow
def test_nothing_is_looked_for_under_what_magnified_noise_leaves():
    """Noise that moves the arm by ten times its readings' own drowns small errors, and not a payload's."""
    rec = recorded("osc")
    loud = Evidence([replace(rec, noise={**NOISE, "dq": 0.02})])
    assert noise_motion(loud, World()) > 20
    assert within_noise(loud, World())
    assert not within_noise(loud, World().add(EffectInstance.of("payload", "flange", mass=2.0)))
    assert not within_noise(Evidence([rec]), World()), "as quiet as usual: the tests of a search say what chance is"
    beside = [replace(rec, noise={**NOISE, "dq": 0.02}), recorded("position")]
    assert not within_noise(Evidence(beside), World()), (
        "a joint's servo magnifies nothing, and may show what is missing"
    )
    coarse = World().add(EffectInstance.of("encoder_quantization", "joint2", step=1.6e-3))
    assert noise_motion(Evidence([rec]), coarse) > 10 and not within_noise(Evidence([rec]), coarse), (
        "steps magnify nothing"
    )


@pytest.mark.slow
def test_a_coarse_encoder_leaves_the_right_model_no_more_than_is_foretold():
    """Under torque control the arm goes another way from each start within a step; friction that is missing shows."""
    coarse = World().add(EffectInstance.of("encoder_quantization", "joint2", step=1.6e-3))
    also = coarse.add(EffectInstance.of("coulomb_friction", "joint4", torque=0.2))
    right, wrong = [], []
    for seed in range(4):
        for hidden, ratios in ((coarse, right), (also, wrong)):
            judge = Judge(Evidence([recorded("torque", hidden, 10 + seed)]))
            more = noise_motion(judge.evidence, coarse)
            (loss,) = judge.losses([coarse])
            ratios.append(judge.mean(loss) / (judge.floor(coarse) + more))
            assert more > 0.5
    assert np.sum(np.array(right) < RULES.adequate) >= 3 and max(right) < min(wrong)
    assert np.all(np.array(wrong) > RULES.adequate)
    fine = World().add(EffectInstance.of("encoder_quantization", "joint2", step=2e-5))
    assert noise_motion(Evidence([recorded("torque")]), fine) == 0.0


def test_a_coarse_encoder_makes_no_value_of_the_right_model_less_certain():
    """All that is left is the encoder's; none of it is an error of the friction's form, nor a bias of its value.

    One recording's value scatters by 0.05 %, so the mean over four is compared with the truth.
    """
    coarse = World().add(EffectInstance.of("encoder_quantization", "joint2", step=4e-4))
    right, begun = (coarse.add(EffectInstance.of("coulomb_friction", "joint4", torque=t)) for t in (2.0, 1.0))
    torques = []
    for seed in (10, 12, 14, 16):
        fitted, judged = (Evidence([recorded("torque", right, s)]) for s in (seed, seed + 1))
        found = calibrate(fitted, begun, (1,), seed=0)
        _, world = fit_record(coarse, found, (1,), fitted, judged)
        assert world.effects[1].params["torque"] == found.fit.world.effects[1].params["torque"]
        torques.append(world.effects[1].params["torque"].value)
    assert np.mean(torques) == pytest.approx(2.0, rel=1e-3)


def test_an_offset_of_all_joints_stays_where_a_draw_starts_elsewhere_within_a_step():
    """The start is the true one less the offset, up to half a step, whichever entry the offset is in."""
    steps = EffectInstance.of("encoder_quantization", "all", step=1e-3)
    shared, own = (EffectInstance.of("encoder_offset", where, offset=0.05) for where in ("all", "joint2"))
    item = Evidence([recorded("torque", World().add(steps, shared))]).items[0]
    for entries, offset in (((shared,), 0.05), ((own,), [0.0, 0.05, *[0.0] * 5]), ((shared, own), 0.05)):
        begun = _begun(item, World().add(steps, *entries), 0)
        found = values(effect("encoder_offset"), [begun.effects], item.robot)["offset"][0]
        assert 1e-6 < np.abs(found - offset).max() <= 0.5e-3


def test_readings_are_as_noisy_as_their_encoders_steps_make_them():
    item = Evidence([recorded("position")]).items[0]
    assert reading_noise(item, World()) == pytest.approx(item.sigma[:7])
    own = reading_noise(item, World().add(EffectInstance.of("encoder_quantization", "joint2", step=1e-3)))
    # a wide step d tips over with probability sigma sqrt(2 / pi) / d, and is then d off
    assert own[1] ** 2 == pytest.approx(1e-3 * item.sigma[1] * np.sqrt(2 / np.pi), rel=0.02)
    assert np.delete(own, 1) == pytest.approx(np.delete(item.sigma[:7], 1))
