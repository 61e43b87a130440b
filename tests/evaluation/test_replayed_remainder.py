"""What no cause explains: the missing torque is what was hidden, and played back it does what it did."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from vispeg.cli.main import main
from vispeg.core.effect import EffectInstance
from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.evaluation.remainder import Missing, Remainder, missing_of, time_constant
from vispeg.recordings.recording import Control
from vispeg.task.environments.vector import TaskVec
from vispeg.trials.trial import folders, read_trial
from vispeg.worlds.world import World

NOISE = 3.0  # N m
HIDDEN = {
    "noise": "{effect: torque_noise, where: joint2, params: {rms: 3.0, time: 0.15}}",
    "drag": "{effect: viscous_friction, where: joint2, params: {damping: 20.0}}",
    "friction": "{effect: coulomb_friction, where: joint4, params: {torque: 6.0}}",
}


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """What the scripted policy did in cells with a hidden effect each."""
    place = tmp_path_factory.mktemp("cells")
    out = {}
    for name, effect in HIDDEN.items():
        world = place / f"{name}.yaml"
        world.write_text(f"format: vispeg-world/1\nbase: nominal\neffects:\n  - {effect}\n")
        argv = ["evaluate", "expert", "--world", str(world), "--episodes", "12", "--videos", "0", "--quiet", "--json"]
        assert main([*argv, "--out", str(place / f"{name}-e"), "--keep-trials", str(place / name)]) == 0
        out[name] = [read_trial(folder).recording for folder in folders(place / name)]
    return out


def series(rng, n, time, period=0.02):
    """Ornstein-Uhlenbeck, (n, 2), the second joint half of the first."""
    a, x = np.exp(-period / time), np.empty(n)
    x[0] = rng.standard_normal()
    for k in range(1, n):
        x[k] = a * x[k - 1] + np.sqrt(1 - a * a) * rng.standard_normal()
    return np.stack([x, 0.5 * x], axis=1)


@pytest.mark.parametrize("time", [0.1, 0.3])
def test_the_time_constant_of_a_known_process_is_its_own(time):
    rng = stream(0, "time constant", str(time))
    found = time_constant([series(rng, 4000, time) for _ in range(10)], 0.02)
    assert found == pytest.approx(time, rel=0.25), "the sum up to the first zero is a little more than the integral"


def test_a_constant_torque_is_no_correlation_in_time():
    """Its block would be as long as the recordings, and none of them would count in any regime."""
    rng = stream(0, "constant")
    pieces = [series(rng, 400, 0.1) for _ in range(10)]
    assert time_constant([p + [1.0, -2.0] for p in pieces], 0.02) == pytest.approx(time_constant(pieces, 0.02))
    missing = [Missing(str(k), 0.02 * np.arange(400), p + 1.0, np.zeros(400, bool)) for k, p in enumerate(pieces)]
    found = Remainder.of(missing, [], ("a", "b"), tick=0.005)
    assert found is not None and found.block < 0.35 and found.regimes()["free air"]["recordings"] == 10


def test_what_is_drawn_has_the_size_and_the_company_of_what_was_left():
    rng = stream(0, "blocks")
    pieces = tuple(series(rng, 150, 0.15) for _ in range(20))
    missing = [Missing(str(k), 0.02 * np.arange(150), p, np.zeros(150, bool)) for k, p in enumerate(pieces)]
    found = Remainder.of(missing, [], ("a", "b"), tick=0.005)
    assert found is not None and 0.25 < found.block < 0.45, "twice 0.15 s"
    drawn = np.concatenate([found.draw(seed, 1600) for seed in range(40)])
    assert np.sqrt(np.mean(drawn**2, axis=0)) == pytest.approx(found.rms, rel=0.1)
    assert drawn[:, 1] == pytest.approx(0.5 * drawn[:, 0]), "joints hang together"
    assert np.array_equal(found.draw(3, 1600), found.draw(3, 1600))
    assert not np.array_equal(found.draw(3, 1600), found.draw(4, 1600))
    half = Missing("floor", missing[0].time, pieces[0] * 0 + found.rms / np.sqrt(2), missing[0].touching)
    less = Remainder.of(missing, [half], ("a", "b"), tick=0.005)
    assert less is not None and less.rms == pytest.approx(found.rms / np.sqrt(2), rel=0.02), "variances add"


def test_what_an_unknown_torque_leaves_is_that_torque(recordings):
    missing = [m for rec in recordings["noise"] if (m := missing_of(rec, World("iiwa14"))) is not None]
    assert len(missing) >= 8
    rms = np.sqrt(np.mean(np.concatenate([m.torque for m in missing]) ** 2, axis=0))
    assert rms[1] == pytest.approx(0.96 * NOISE, rel=0.15), "below 8 Hz is 92 % of its power, short trials scatter"
    assert np.delete(rms, 1).max() < 0.2, "and no other joint"


def test_the_missing_torque_acts_on_the_links_as_what_was_hidden_does(recordings):
    """Hidden viscous friction of 20 N m s/rad: its missing torque is that, against the motion."""
    torque, speed = [], []
    for rec in recordings["drag"]:
        if (m := missing_of(rec, World("iiwa14"))) is not None:
            torque.append(m.torque[:, 1])
            speed.append(np.interp(m.time, rec.time - rec.time[0], np.gradient(rec.q[:, 1], rec.time)))
    torque, speed = np.concatenate(torque), np.concatenate(speed)
    assert speed @ torque / (speed @ speed) == pytest.approx(-20.0, rel=0.05)


def test_the_right_model_leaves_nothing_though_a_joint_sticks(recordings):
    """A joint that stands holds any torque up to its dry friction: none of it is missing."""
    right = World("iiwa14").add(EffectInstance.of("coulomb_friction", "joint4", torque=6.0))
    left, touched = {}, np.empty((0, 7))
    for name, world in (("wrong", World("iiwa14")), ("right", right)):
        missing = [m for rec in recordings["friction"] if (m := missing_of(rec, world)) is not None]
        touched = np.concatenate([m.torque[m.touching] for m in missing])
        left[name] = np.sqrt(np.mean(np.concatenate([m.torque for m in missing]) ** 2, axis=0))
    assert left["wrong"][3] > 3.0 and left["right"][3] < 1.0 and np.delete(left["right"], 3).max() < 0.2
    assert len(touched) > 50 and np.sqrt(np.mean(touched**2, axis=0)).max() < 1.0, "the measured wrench acts too"


def test_weaker_drives_that_are_asked_for_more_leave_the_same(recordings):
    """Drives of gain 0.8 and bias 1 N m, asked for so much that they deliver the same, in contact too."""
    weak = World("iiwa14").add(
        EffectInstance.of("torque_gain", "all", gain=0.8), EffectInstance.of("joint_bias", "all", torque=1.0)
    )
    touching = 0
    for rec in recordings["friction"]:
        asked = Control("torque", rec.control.rate_hz)
        tau = 20.0 * np.sin(rec.time[:, None] + np.arange(7))
        plain = missing_of(replace(rec, control=asked, tau_cmd=tau), World("iiwa14"))
        more = missing_of(replace(rec, control=asked, tau_cmd=(tau - 1.0) / 0.8), weak)
        if plain is None or more is None:
            continue
        np.testing.assert_allclose(more.torque, plain.torque, atol=1e-9)
        touching += plain.touching.sum()
    assert touching > 50


def test_a_recording_whose_controller_is_unknown_is_refused(recordings):
    with pytest.raises(UserError, match="the commanded torque is not known"):
        missing_of(replace(recordings["noise"][0], control=Control("unknown")), World("iiwa14"))


def test_torques_on_the_links_move_the_arm_as_the_force_does_that_makes_them():
    """A force at the last link, or the torques that MuJoCo says it makes: the flange goes to the same place."""
    env = TaskVec(3, world="nominal", autoreset_mode="Disabled")
    env.reset(seed=[5, 5, 5])
    force, cell = np.array([12.0, -6.0, 0.0]), env.sim.cell
    data, torque = mujoco.MjData(cell.model), np.zeros(cell.model.nv)
    data.qpos[:] = cell.qpos[1]
    mujoco.mj_forward(cell.model, data)
    mujoco.mj_applyFT(cell.model, data, force, np.zeros(3), data.xipos[cell.hand], cell.hand, torque)
    env.push([0], force, 0.0, 5.0)  # it acts at the centre of the last link
    env.disturb(1, torque[cell.dofs][None])
    begun = env.sim.cell.site_position("flange").copy()
    for _ in range(2):
        env.step(np.zeros((3, len(env.config.dof)), np.float32))
    pushed, torqued, free = env.sim.cell.site_position("flange") - begun
    assert np.linalg.norm(pushed) > 0.002
    assert torqued == pytest.approx(pushed, abs=0.01 * np.linalg.norm(pushed))
    assert np.linalg.norm(free) < 0.1 * np.linalg.norm(pushed)
    env.reset(seed=[5, 5, 5])
    for _ in range(2):
        env.step(np.zeros((3, len(env.config.dof)), np.float32))
    after = env.sim.cell.site_position("flange") - begun
    assert np.ptp(after, axis=0).max() < 1e-12, "an episode's torques end with it"
    env.close()
