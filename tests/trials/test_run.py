"""The run loop: the policy's episode in the simulator again, limits that stop the arm, time that is kept, bad input."""

import os
import signal
import socket
import sys
import threading
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lockstep import Lockstep

from vispeg.api.run import opened
from vispeg.cli.main import main
from vispeg.core.errors import UserError
from vispeg.interface.interface import Interface
from vispeg.recordings.load import load
from vispeg.task.environments.vector import TaskVec
from vispeg.task.interface import interface_of
from vispeg.task.registry import task_of
from vispeg.trials.driver import Connected, Reading
from vispeg.trials.limits import Limits
from vispeg.trials.loop import Clock, How, run_episode
from vispeg.trials.simulated import SimulatedRobot, serve
from vispeg.trials.socket_robot import SocketRobot
from vispeg.trials.trial import PolicyPart, read_trial, write_trial

SEED, WHO = 1_000_004, PolicyPart(name="scripted")


class Scripted:
    """The task's expert behind a policy's interface."""

    def __init__(self, config):
        self.expert = task_of(config).expert(config, 1)

    def reset(self, n, rows=None):
        self.expert.reset(np.arange(n))

    def act(self, obs):
        return self.expert.act(obs)


def meaning(robot: SimulatedRobot, **changes) -> Interface:
    """What the expert sees and does."""
    env = robot.env
    return interface_of(env.config, env.sim.scene, "state", (), (), modality="state").model_copy(update=changes)


@pytest.fixture(scope="module")
def robot():
    return Lockstep("nominal")


def ran(robot, how=None, policy=None, rest=0.0, **changes):
    """An episode of the expert on the robot that waits; the policy acts at once, as it does in the environment."""
    how = replace(how or How(), rest=rest)
    interface = meaning(robot.robot, **changes)
    robot.commands, robot.stopped, robot.late = [], 0, 0.0
    policy = policy or Scripted(robot.robot.config)
    return run_episode(policy, interface, robot, WHO, SEED, how, clock=robot, name="lockstep", watch=False)


def test_on_a_robot_that_waits_the_loop_is_the_environment(robot, tmp_path):
    """Same observations, same actions, same outcome as an episode in the simulator; and it is read back as a trial."""
    trial = ran(robot)
    env, expert = TaskVec(1, "nominal", autoreset_mode="Disabled"), Scripted(robot.robot.config)
    obs, _ = env.reset(seed=[SEED])
    expert.reset(1)
    for k in range(len(trial.steps.time)):
        np.testing.assert_array_equal(np.float32(trial.steps.seen[k]), obs["policy"][0], err_msg=f"step {k}")
        obs, _, ended, _, info = env.step(expert.act(obs))
    assert ended[0] and trial.said.outcome.success and robot.stopped == 1
    assert trial.said.outcome.peak_force_n == pytest.approx(info["record"][0]["peak_force"], rel=1e-9)

    again = read_trial(write_trial(trial, tmp_path / "trial-0001"))
    assert again.said == trial.said
    for name in ("time", "late", "seen", "action", "target"):
        np.testing.assert_array_equal(getattr(again.steps, name), getattr(trial.steps, name))
    rec = load(tmp_path / "trial-0001")
    assert rec.outcomes[0].success and rec.control.mode == "osc" and rec.rate_hz == 200
    np.testing.assert_array_equal(rec.q, trial.recording.q)

    obs, _ = TaskVec(1, "S", autoreset_mode="Disabled").reset(seed=[1], options={"start": again.said.begin()})
    np.testing.assert_allclose(obs["policy"][0, :3], trial.steps.seen[0, :3], atol=1e-6)  # the tip, from the belief


@pytest.mark.parametrize(
    ("limits", "category"),
    [(Limits(force=1.0), "force limit"), (Limits(speed=0.01), "speed limit"), (Limits(reach=0.03), "workspace")],
)
def test_a_limit_stops_the_arm_and_says_so(robot, limits, category):
    class Away(Scripted):
        def act(self, obs):
            return (
                np.sign(obs["policy"][:, :3]) * [1, 1, 0] + [0, 0, -1] if category == "workspace" else super().act(obs)
            )

    trial = ran(robot, How(limits), Away(robot.robot.config))
    outcome = trial.said.outcome
    assert outcome.category == category and not outcome.success and outcome.by == "measured"
    assert robot.stopped == 1 and outcome.time_s < 3.0


def test_an_arm_beyond_a_limit_before_the_policy_acts_is_not_begun_with(robot):
    with pytest.raises(UserError, match="before the policy acted; got 'workspace'"):
        ran(robot, How(Limits(reach=0.001)))
    assert robot.stopped == 1 and not robot.commands


def test_joints_beyond_their_range_or_too_fast_stop_the_arm(robot):
    arm = meaning(robot.robot).arm
    q = robot.robot.sim.home[0]
    near = arm.model_copy(update={"high_rad": tuple(np.where(np.arange(7) == 1, q[1] + 0.01, arm.high_rad))})
    assert ran(robot, arm=near).said.outcome.category == "joint limit"
    slow = arm.model_copy(update={"velocity_limit": (0.01,) * 7})
    assert ran(robot, arm=slow).said.outcome.category == "joint velocity"


def test_a_shadow_computes_and_does_not_move_the_arm(robot):
    trial = ran(robot, How(shadow=True), steps=8)
    assert not robot.commands and trial.said.how.shadow and trial.said.outcome.category == "approach"
    assert len(trial.steps.time) == 8 and np.abs(trial.steps.action).max() > 0.5
    assert np.ptp(trial.recording.ee[:, :3], axis=0).max() < 1e-3


def test_slow_asks_for_a_share_of_each_offset_in_more_steps(robot):
    class Down:
        def reset(self, n, rows=None): ...

        def act(self, obs):
            return np.array([[0.0, 0.0, -1.0]])

    full, slow = (ran(robot, How(Limits(), slow=s), Down(), steps=3) for s in (1.0, 0.25))
    z = [trial.steps.target[0, 2] - trial.recording.ee[0, 2] for trial in (full, slow)]
    np.testing.assert_allclose(z, [-0.010, -0.0025], atol=1e-9)
    assert (len(full.steps.time), len(slow.steps.time)) == (3, 12)


def test_a_key_stops_and_what_was_done_is_kept(robot):
    pressed = iter([False] * 100 + [True] * 9)
    interface = meaning(robot.robot)
    policy = Scripted(robot.robot.config)
    trial = run_episode(
        policy, interface, robot, WHO, SEED, How(rest=0.0), clock=robot, key=lambda: next(pressed), watch=False
    )
    assert trial.said.outcome.category == "stopped" and len(trial.steps.time) == 4


def test_the_robots_time_is_the_policys(robot):
    """A policy that waits after the rest and then succeeds within its 8 s has succeeded."""

    class Waiting(Scripted):
        left = 0

        def act(self, obs):
            self.left -= 1
            return np.zeros((1, 3)) if self.left >= 0 else super().act(obs)

    config, policy = robot.robot.config, Waiting(robot.robot.config)
    alone = ran(robot).said.outcome.time_s
    policy.left = int((config.steps * config.policy_period - alone) / config.policy_period) - 2
    outcome = ran(robot, policy=policy, rest=1.2).said.outcome
    assert outcome.time_s + 1.2 > config.steps * config.policy_period, "beyond the limit if it ran from the rest"
    assert outcome.success and outcome.category == "success"


def test_a_robot_that_judges_the_task_ends_the_episode_and_not_the_height_above_a_mistaken_goal(robot):
    high = np.array(meaning(robot.robot).goal.nominal_m) + [0.0, 0.0, 0.004]
    outcome = ran(robot, How(goal=tuple(high))).said.outcome
    assert outcome.success and outcome.by == "robot" and outcome.depth_m >= 0.02


def test_after_a_rest_of_another_length_than_a_policy_period_an_episode_takes_as_long(robot):
    assert ran(robot, rest=1.2).said.outcome.time_s == pytest.approx(ran(robot).said.outcome.time_s)


@pytest.mark.parametrize(
    ("told", "stated", "success"), [(True, None, False), (False, None, True), (False, (0.0, 0.0, 0.0), False)]
)
def test_a_tip_as_deep_beside_a_goal_whose_place_is_stated_is_no_success(robot, told, stated, success):
    """By measured place alone, of a robot that does not judge the task."""

    class Blind(Lockstep):
        def ended(self): ...

        def stop(self):
            super().stop()

    class Down:
        def reset(self, n, rows=None): ...

        def act(self, obs):
            return np.array([[0.0, 0.0, -1.0]])

    blind, known = Blind.__new__(Blind), meaning(robot.robot).goal
    blind.__dict__.update(robot.__dict__)
    high = tuple(np.add(known.nominal_m, [0.05, 0.0, 0.025]))  # the tip gets below its depth, 5 cm aside
    goal = known.model_copy(update={"nominal_m": high, "told": told})
    how = How(Limits(force=1000.0), goal=None if stated is None else high)

    def told_high(interface, seed):
        return replace(Lockstep.connect(blind, interface, seed), start={"believed_m": high})

    blind.connect = told_high
    outcome = ran(blind, how, Down(), goal=goal, steps=8).said.outcome
    assert (outcome.success, outcome.by) == (success, "measured")


def test_a_trial_states_the_belief_that_the_policy_was_told(robot):
    told = tuple(np.array(meaning(robot.robot).goal.nominal_m) + [0.01, 0.0, 0.0])
    trial = ran(robot, How(goal=told), steps=2)
    assert trial.said.start.believed_m == pytest.approx(told)


@pytest.mark.parametrize("acts_on", ["flange", "tool"])
def test_joints_of_another_arm_are_named_whatever_its_sensor(robot, acts_on):
    from vispeg.recordings.cell import WrenchSensor

    class Six(Lockstep):
        def connect(self, interface, seed):
            return replace(super().connect(interface, seed), wrench=WrenchSensor(acts_on=acts_on))

        def read(self, cameras=()):
            reading = super().read(cameras)
            return replace(reading, q=reading.q[:6], dq=reading.dq[:6])

    six = Six.__new__(Six)
    six.__dict__.update(robot.__dict__)
    with pytest.raises(UserError, match="joints of another arm"):
        ran(six)


@pytest.mark.parametrize("wrench", [None, np.zeros(3)])
def test_a_driver_that_states_a_wrench_and_measures_none_is_refused(robot, wrench):
    class Mute(Lockstep):
        def read(self, cameras=()):
            return replace(super().read(cameras), wrench=wrench)

    mute = Mute.__new__(Mute)
    mute.__dict__.update(robot.__dict__)
    with pytest.raises(UserError, match="no wrench; expected six numbers"):
        ran(mute)


def test_late_commands_are_counted(robot):
    class Slow(Scripted):
        def act(self, obs):
            robot.late += 0.03
            return super().act(obs)

    timing = ran(robot, policy=Slow(robot.robot.config), steps=4).said.timing
    assert timing.missed == timing.steps and timing.late_median_s == pytest.approx(0.03) and timing.deadline_s == 0.02


def test_the_rest_before_the_policy_acts_is_as_long_on_the_robots_own_clock(robot):
    """A simulated robot on a busy machine is slower than the host, and a recording is read by its clock."""

    class Slow(Lockstep):
        def read(self, cameras=()):
            reading = super().read(cameras)
            return replace(reading, time=0.8 * reading.time)

    for clock in (robot, Slow.__new__(Slow)):
        clock.__dict__.update(robot.__dict__)
        policy, how = Scripted(robot.robot.config), How(rest=0.6)
        interface = meaning(robot.robot, steps=3)
        trial = run_episode(policy, interface, clock, WHO, SEED, how, clock=clock, watch=False)
        assert trial.steps.time[0] == pytest.approx(0.6, abs=0.005)


class Faulty(Lockstep):
    """Whose sensors freeze, or who goes away, after half a second."""

    fault = ""

    def read(self, cameras=()):
        reading = super().read(cameras)
        if self.robot.time < 0.5:
            self.last = reading
            return reading
        if self.fault == "gone":
            raise OSError("no route to robot")
        return replace(reading, q=np.full(7, np.nan)) if self.fault == "nan" else self.last


@pytest.mark.parametrize("fault", ["frozen", "gone", "nan"])
def test_a_robot_that_says_nothing_new_is_stopped(robot, fault):
    faulty = Faulty.__new__(Faulty)
    faulty.__dict__.update(robot.__dict__, fault=fault)
    trial = ran(faulty)
    assert trial.said.outcome.category == "watchdog" and faulty.stopped == 1
    assert np.isfinite(trial.recording.time).all() and trial.recording.time[-1] < 0.8
    why = {"frozen": "no new reading for 0.25 s", "gone": "no route to robot", "nan": None}
    assert trial.said.outcome.why == why[fault]


def test_a_robot_whose_clock_jumps_is_stopped(robot):
    class Set(Lockstep):  # its time is set while it moves, as by a time server
        def read(self, cameras=()):
            reading = super().read(cameras)
            return replace(reading, time=reading.time + (100.0 if self.robot.time > 0.5 else 0.0))

    jumping = Set.__new__(Set)
    jumping.__dict__.update(robot.__dict__)
    trial = ran(jumping)
    assert trial.said.outcome.category == "watchdog" and "jumped forward by 100 s" in trial.said.outcome.why
    assert trial.recording.time[-1] < 0.8 and trial.said.outcome.time_s < 0.8


class Stuck:
    """A driver whose `read` never returns, as one does that waits for a message."""

    def __init__(self):
        self.reads, self.stopped, self.began = 0, 0, time.monotonic()

    def connect(self, interface, seed):
        return Connected()

    def read(self, cameras=()):
        self.reads += 1
        while self.reads > 3:
            time.sleep(0.02)
        q = np.array([0.4, 0.86, -0.62, -1.56, 0.6, 0.92, 2.7])
        return Reading(time.monotonic(), q, np.zeros(7), np.zeros(6))

    def command(self, pose): ...

    def stop(self):
        self.stopped += 1


@pytest.mark.parametrize("handled", [signal.default_int_handler, signal.SIG_IGN], ids=["terminal", "background"])
def test_a_watchdog_stops_a_robot_whose_driver_hangs(robot, handled):
    """In a terminal, and where a shell's background job ignores interrupts."""
    stuck, interface = Stuck(), meaning(robot.robot)
    before = signal.signal(signal.SIGINT, handled)
    try:
        trial = run_episode(
            Scripted(robot.robot.config), interface, stuck, WHO, 0, How(Limits(reach=2.0), silence=0.1, rest=0.0)
        )
        assert signal.getsignal(signal.SIGINT) is handled
    finally:
        signal.signal(signal.SIGINT, before)
    assert trial.said.outcome.category == "watchdog" and stuck.stopped >= 1
    assert time.monotonic() - stuck.began < 30


def test_a_wrench_in_other_words_is_the_same_to_the_policy(robot):
    """A driver may read it in the base's axes, as what acts on the tool, zeroed once, or with the tool's weight off."""
    from vispeg.recordings.cell import WrenchSensor

    class Told(Lockstep):
        sensor, zero = WrenchSensor(), None

        def connect(self, interface, seed):
            self.interface = interface
            return replace(super().connect(interface, seed), wrench=self.sensor)

        def read(self, cameras=()):
            r = super().read(cameras)
            turn = self.interface.chain.rotation(r.q[None])[0]
            force, torque = turn @ r.wrench[:3], turn @ r.wrench[3:]
            tool = self.interface.tool
            weight = turn.T @ tool.weight_n  # by hand: a sensor feels it at the centre of mass
            weight = np.concatenate([weight, np.cross(tool.com_m, weight)])
            if self.sensor.tared:
                self.zero = weight if self.zero is None or self.sensor.tared == "weight" else self.zero
                force, torque = force - turn @ self.zero[:3], torque - turn @ self.zero[3:]
            sign = -1.0 if self.sensor.acts_on == "tool" else 1.0
            return replace(r, wrench=sign * np.concatenate([force, torque]))

    told = Told.__new__(Told)
    told.__dict__.update(robot.__dict__)
    plain = ran(robot, steps=6)
    tares = (WrenchSensor("base", "tool", tared) for tared in (False, True))
    for sensor in (*tares, WrenchSensor("base", "flange", "weight")):
        told.sensor = sensor
        trial = ran(told, steps=6)
        n = min(len(trial.steps.time), len(plain.steps.time), 6)
        np.testing.assert_allclose(trial.steps.seen[:n], plain.steps.seen[:n], atol=1e-5)
        assert trial.said.outcome.peak_force_n == pytest.approx(plain.said.outcome.peak_force_n, abs=1e-3)


def test_a_sensor_zeroed_once_feels_no_contact_in_free_air_however_its_tool_is_turned(robot):
    """Physics: the constant taken off is the weight in the sensor's axes at the start, not the weight thereafter."""
    from vispeg.recordings.cell import WrenchSensor

    class Turning(Clock):
        time = 0.0

        def now(self):
            return self.time

        def wait(self, until):
            self.time = max(self.time, until)

        def connect(self, interface, seed):
            self.interface = interface
            return Connected(wrench=WrenchSensor(acts_on="flange", tared=True))

        def weight(self, q):
            return self.interface.tool.weight_at(self.interface.chain.rotation(q[None])[0])

        def read(self, cameras=()):
            home = np.array(self.interface.arm.home_rad)
            q, dq = home.copy(), np.zeros(7)
            q[5] += 0.2 * self.time  # rad
            return Reading(self.time, q, dq, self.weight(q) - self.weight(home))

        def command(self, pose): ...

        def stop(self): ...

    tool = meaning(robot.robot).tool.model_copy(update={"weight_n": (0.0, 0.0, -9.81)})
    interface, arm = meaning(robot.robot, tool=tool, steps=4), Turning()
    how = How(Limits(reach=2.0), rest=0.0)
    trial = run_episode(Scripted(robot.robot.config), interface, arm, WHO, 0, how, clock=arm, watch=False)
    turned = 9.81 * 2 * np.sin(0.1 * arm.time)
    assert turned > 0.5, "the readings themselves are not 0"
    assert trial.said.outcome.peak_force_n < 0.02


def test_a_socket_robot_that_answers_too_late_is_not_asked_again():
    """Its late answer is not taken for that of the next message; the next episode has a process of its own."""
    pytest.importorskip("torch")
    interface = opened("state-3mm", None, None)[1]
    robot = SocketRobot("nominal")
    try:
        robot.connect(interface, 0)
        os.kill(robot._process.pid, signal.SIGSTOP)
        with pytest.raises(OSError, match="timed out"):
            robot.read()
        assert robot.stop() is None
        assert len(robot.connect(interface, 1).start["goal_m"]) == 3 and len(robot.read().q) == 7
    finally:
        robot.close()


def test_a_simulated_robot_waits_for_its_first_message_without_work():
    simulated = SimulatedRobot("nominal", "state", {})
    here, there = socket.socketpair()

    def served():
        with suppress(EOFError):
            serve(simulated, there, 0.0)

    thread = threading.Thread(target=served)
    with here, there:
        thread.start()
        time.sleep(1.2)
        before = time.process_time()
        time.sleep(0.5)
        worked = time.process_time() - before
        here.close()
        thread.join()
    assert worked < 0.1


def test_a_socket_robot_in_its_own_time_from_the_command_line(tmp_path, capsys):
    """Real time on a machine that may be busy: what is asserted holds however late the loop is."""
    pytest.importorskip("torch")
    robot = "sim:nominal?latency=0.01"
    argv = ["run", "state-3mm", "--robot", robot, "--seed", str(SEED), "--slow", "1", "--out", str(tmp_path / "t")]
    assert main([*argv, "--json"]) == 0
    trial = read_trial(tmp_path / "t" / "trial-0001")
    assert trial.said.world.name == "nominal" and trial.said.start.goal_m is not None
    assert trial.said.timing.steps > 2 and '"missed"' in capsys.readouterr().out
    assert np.all(np.diff(trial.recording.time) > 0)
    (tmp_path / "t" / "why").mkdir()  # as `explain t --out t/why` leaves it: further trials go beside it
    assert main([*argv, "--shadow", "--json"]) == 0
    assert {p.name for p in tmp_path.glob("t/[!.]*")} == {"trial-0001", "trial-0002", "why"}


@pytest.mark.parametrize(
    ("argv", "named"),
    [
        ("run state-3mm --robot mars --out o", "--robot"),
        ("run state-3mm --robot sim:nowhere --out o", "nowhere"),
        ("run state-3mm --robot sim:nominal?lag=1 --out o", "latency"),
        ("run state-3mm --robot python:no_such:Thing --out o", "no_such"),
        ("run state-3mm --robot python:pathlib:Path --out o", "connect"),
        ("run state-3mm --robot sim:nominal --slow 0 --out o", "--slow"),
        ("run state-3mm --robot sim:nominal --force -3 --out o", "--force"),
        ("run state-3mm --robot sim:nominal --episodes 0 --out o", "--episodes"),
        ("run expert --robot sim:nominal --out o", "policy"),
        ("run nothing.onnx --robot sim:nominal --out o", "nothing.onnx"),
        ("run state-3mm --robot sim:nominal --out taken", "taken"),
        ("run state-3mm --robot sim:nominal --ask --out o", "--ask"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(tmp_path, monkeypatch, capsys, argv, named):
    pytest.importorskip("torch")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "thesis.txt").write_text("mine")
    assert main(argv.split()) == 2
    said = capsys.readouterr().err.strip()
    assert named in said and "\n" not in said, said
    assert sorted(p.name for p in tmp_path.rglob("*") if not p.name.startswith(".")) == ["taken", "thesis.txt"]


DRIVER = """
import numpy as np
from vispeg.trials.driver import Connected, Reading

class Still:
    def __init__(self):
        self.time = 0.0
    def connect(self, interface, seed):
        self.q = np.array(interface.arm.home_rad)
    def read(self, cameras=()):
        self.time += 0.005
        return Reading(self.time, self.q, 0 * self.q, np.zeros(6))
    def command(self, pose): ...
    def stop(self): ...
"""


def test_an_exported_policy_runs_on_a_driver_of_ones_own_without_torch_and_without_a_simulator(tmp_path):
    import subprocess

    pytest.importorskip("onnxruntime")
    pytest.importorskip("torch")
    from vispeg.api.export.policy import export_policy

    export_policy("state-3mm", tmp_path / "p.onnx")
    (tmp_path / "mine.py").write_text(DRIVER)
    code = (
        "import sys; from vispeg.cli.main import main; "
        "code = main('run fine=p.onnx --robot python:mine:Still --shadow --reach 2 --out t'.split()); "
        "assert not {'torch', 'mujoco', 'gymnasium'} & set(sys.modules); sys.exit(code)"
    )
    where = str(Path(sys.modules["vispeg"].__file__).parents[1])
    path = {"PYTHONPATH": f"{tmp_path}:{where}", "PATH": "/usr/bin:/bin"}
    subprocess.run([sys.executable, "-c", code], check=True, cwd=tmp_path, env=path, timeout=120)
    said = read_trial(tmp_path / "t" / "trial-0001").said
    assert (said.policy.name, said.outcome.category) == ("fine", "timeout")


def test_a_term_that_only_a_task_knows_is_refused_before_the_robot_moves(robot):
    told = meaning(robot.robot).told
    odd = (*told[:-1], told[-1].model_copy(update={"name": "latch"}))
    with pytest.raises(UserError, match="latch"):
        ran(robot, told=odd)
