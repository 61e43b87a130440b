"""A joint that is known, measured from noisy motions: closed forms, loops that were drawn, and MuJoCo as the judge."""

import re
import subprocess
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy import signal

from vispeg.api.measure.plan import plan_joint
from vispeg.cli.main import main
from vispeg.core.errors import UserError
from vispeg.measure import frequency, joint, steps
from vispeg.measure.actuator import alone, element, simulated
from vispeg.measure.arm import about
from vispeg.measure.plan import plan, table
from vispeg.measure.steps import Servo, step_answer
from vispeg.measure.trace import Trace, from_table, refuse_no_servo, sines, strokes
from vispeg.robots.model import load
from vispeg.worlds.measurement_file import Quantity

RATE = 500.0
TRUE = Servo(0.97, 30.0, 0.6, 0.012)


def rng(seed=0):
    return np.random.default_rng(seed)


def parts(seed=0):
    return {p.name: p for p in plan(load("iiwa14"), "joint1", 0.0, 0.1, RATE, rng(seed))}


def answered(part, servo=TRUE, noise=2e-5, seed=0, name=None):
    """The motion of a joint that is exactly this servo: its transfer function by SciPy, apart from what is tested."""
    t, u = part.time, part.offset
    wn, z = servo.natural_frequency, servo.damping_ratio
    late = (
        np.interp(t - servo.delay, t, u, left=0.0)
        if "steps" not in part.name
        else np.concatenate([np.zeros(round(servo.delay * RATE)), u])[: len(u)]
    )
    system = signal.cont2discrete(([servo.gain * wn**2], [1, 2 * z * wn, wn**2]), 1 / RATE, "zoh")
    y = signal.lfilter(np.squeeze(system[0]), system[1], late)
    return Trace(name or part.name, t, u, y + noise * rng(seed).standard_normal(len(t)))


@pytest.mark.parametrize("zeta", [0.1, 0.7, 1.0, 3.0])
def test_step_answer_is_the_transfer_function_s(zeta):
    t = np.linspace(0, 1, 300)
    _, y = signal.step(([400.0], [1, 2 * zeta * 20, 400.0]), T=t)
    assert np.allclose(step_answer(t, 20.0, zeta), y, atol=2e-5)


@pytest.mark.parametrize("zeta", [0.2, 0.7, 1.5])
def test_bandwidth_is_where_the_transfer_function_has_lost_three_decibels(zeta):
    servo = Servo(1.3, 25.0, zeta, 0.01)
    assert abs(servo.response(np.array([servo.bandwidth_hz]))[0]) == pytest.approx(1.3 / np.sqrt(2))


def test_the_servo_of_steps_comes_back_and_predicts_the_size_held_out():
    traces = [answered(p, seed=k) for k, p in enumerate(parts().values()) if p.name.startswith("steps")]
    found = joint.measure(traces, rng())
    by_name = {q.quantity: q for q in found.results}
    for name in steps.NAMES:
        assert by_name[name].value == pytest.approx(getattr(TRUE, name), rel=0.01, abs=1e-3)
    assert by_name["bandwidth_from_steps"].value == pytest.approx(TRUE.bandwidth_hz, rel=0.01)
    assert found.details["held_out"]["size_rad"] == pytest.approx(0.05)
    assert found.details["held_out"]["error_of_step"] < 0.01


def test_steps_of_the_plan_rest_long_enough_for_a_joint_that_swings():
    """As the first joint of a simulated iiwa with its usual gains, which halves a swing in a third of a second."""
    true = Servo(0.97, 11.0, 0.2, 0.012)
    found = joint.measure([answered(p, true) for name, p in parts().items() if name.startswith("steps-100")], rng())
    by_name = {q.quantity: q for q in found.results}
    for name in steps.NAMES:
        assert by_name[name].value == pytest.approx(getattr(true, name), rel=0.01, abs=1e-3), name


@pytest.mark.parametrize(("wn", "zeta", "hold"), [(20.0, 0.1, 0.5), (8.0, 0.03, 0.7), (40.0, 2.0, 0.4)])
def test_a_swing_that_goes_on_into_the_next_step_moves_no_number(wn, zeta, hold):
    """The sum of step responses is the exact motion. The last step is cut off 0.3 s after its command."""
    true, sizes, t = Servo(0.97, wn, zeta, 0.004), [0.05, -0.05, 0.1, -0.1], np.arange(0, 1.3 + 3 * hold, 0.002)
    begins = 1.0 + hold * np.arange(len(sizes))
    command = sum(size * (t >= at - 1e-9) for at, size in zip(begins, sizes, strict=True))
    q = sum(0.97 * size * step_answer(t - at - 0.004, wn, zeta) for at, size in zip(begins, sizes, strict=True))
    found = joint.measure([Trace("swings", t, command, q + 1e-5 * rng().standard_normal(len(t)))], rng())
    by_name = {quantity.quantity: quantity for quantity in found.results}
    for name in steps.NAMES:
        assert by_name[name].value == pytest.approx(getattr(true, name), rel=2e-3, abs=1e-4), name
    assert not any("logged late" in note or "not second order" in note for note in found.notes)


@pytest.mark.slow
def test_intervals_of_the_servo_hold_over_sizes_that_differ():
    """Each size and direction has a servo of its own, 5 % about the truth: the stated interval is of their mean.

    The gain is the same in all, so that its scatter tells less than what the others' leave of it: half a per cent.
    """
    held = dict.fromkeys(("natural_frequency", "damping_ratio"), 0)
    motions = [p for n, p in parts().items() if n.startswith("steps")][:3]
    kept = np.r_[:750, 1500:2250, 3000:3800]  # of each rest a second and a half
    short = [type(p)(p.name, p.shows, p.time[:2300], p.offset[kept]) for p in motions]
    for seed in range(25):
        r = rng(seed)
        traces = []
        for k, part in enumerate(short):
            up, down = (
                replace(TRUE, **{name: getattr(TRUE, name) * np.exp(0.05 * r.standard_normal()) for name in held})
                for _ in range(2)
            )
            of_up, of_down = (answered(part, own, seed=100 * seed + k) for own in (up, down))
            change = np.diff(part.offset, prepend=0.0)
            last = change[np.maximum.accumulate(np.where(change != 0.0, np.arange(len(change)), 0))]
            traces.append(replace(of_up, q=np.where(last < 0.0, of_down.q, of_up.q)))
        by_name = {q.quantity: q for q in joint.measure(traces, r).results}
        for name in held:
            held[name] += by_name[name].low <= getattr(TRUE, name) <= by_name[name].high
        assert by_name["gain"].value == pytest.approx(TRUE.gain, rel=5e-3)
    assert min(held.values()) >= 21, held


def test_sines_give_the_transfer_function_with_coherence():
    trace = answered(parts()["sines-large"])
    assert len(sines(trace)) == 7
    for p in frequency.points(trace):
        held = np.exp(-1j * np.pi * p.hz / RATE)  # a command held for a sample comes half of it late
        true = TRUE.response(np.array([p.hz]))[0] * held
        assert abs(p.response / true - 1) < 0.03, p.hz
        assert p.used and p.coherence > 0.99
    servo, _, _ = frequency.fit(frequency.points(trace))
    assert servo.natural_frequency == pytest.approx(30.0, rel=0.02)
    assert servo.damping_ratio == pytest.approx(0.6, rel=0.03)


@pytest.mark.slow
def test_the_interval_of_the_bandwidth_holds_between_the_frequencies_of_the_plan():
    """The -3 dB point lies between sines of 2, 4 and 8 Hz: a line between them misses it by more than their noise."""
    held = 0
    for seed in range(12):
        r = rng(seed)
        true = Servo(r.uniform(0.9, 1.05), r.uniform(14, 35), r.uniform(0.5, 0.9), 0.004)
        motions = [p for n, p in parts(seed).items() if n.startswith("sines")]
        found = joint.measure([answered(p, true, noise=1e-4, seed=seed + k) for k, p in enumerate(motions)], r)
        q = next(q for q in found.results if q.quantity == "bandwidth")
        held += q.low <= true.bandwidth_hz <= q.high
        assert q.high - q.low < 0.15 * q.value
    assert held >= 10


def test_a_bandwidth_between_three_frequencies_may_be_anywhere_between_two():
    some = [frequency.Point(hz, 0.01, complex(TRUE.response(np.array([hz]))[0]), 1.0, 10) for hz in (0.5, 2.0, 8.0)]
    hz, u, _ = frequency.bandwidth(some)
    assert abs(hz - TRUE.bandwidth_hz) < np.sqrt(3) * u


def test_a_sweep_does_so_too():
    t = np.arange(0, 60, 1 / RATE)
    part = type(parts()["triangle"])("sweep", "", t, 0.05 * signal.chirp(t, 0.2, 60, 8.0))
    found = frequency.points(answered(part))
    assert len(found) > 10
    middle = [p for p in found if 0.5 < p.hz < 7]
    assert max(abs(p.response / TRUE.response(np.array([p.hz]))[0] - 1) for p in middle) < 0.06


def test_what_is_not_the_command_s_is_refused():
    trace = answered(parts()["sines-small"], noise=0.02)
    found = joint.measure([trace], rng())
    assert any(not p.used for p in found.points)
    assert any("refused for a coherence below 0.9" in note for note in found.notes)
    assert not any(row["used"] for row in found.details["bode"] if row["coherence"] < 0.9)


def dragged(part, coulomb=1.2, viscous=2.0, gap=2e-3, load=0.3, noise=0.05, seed=0):
    """A quasi-static joint that sticks for 1 mrad of command at each turn, then crosses the gap at no torque."""
    u, dt = part.offset, 1 / RATE
    q = u.copy()
    for k in range(1, len(u)):
        q[k] = min(max(q[k - 1], u[k] - 0.5e-3), u[k] + 0.5e-3)
    v = np.gradient(q, dt)
    way = np.sign(np.where(np.abs(v) > 1e-5, v, 0.0))
    for k in range(1, len(way)):
        way[k] = way[k] or way[k - 1]
    tau = way * (coulomb + viscous * np.abs(v)) + load
    for k in np.flatnonzero(np.diff(way) != 0):
        moved = np.cumsum(np.abs(v[k + 1 :]) * dt)
        if abs(load) < coulomb:
            tau[k + 1 : k + 1 + int(np.searchsorted(moved, gap))] = 0.0
    r = rng(seed)
    q = q - 0.01 * v + 1e-5 * r.standard_normal(len(v))
    return Trace(part.name, part.time, u, q, tau + noise * r.standard_normal(len(v)))


def test_friction_is_the_height_of_the_loop_and_backlash_its_width():
    motions = parts()
    found = joint.measure([dragged(motions["ladder"]), dragged(motions["triangle"], seed=1)], rng())
    by_name = {q.quantity: q for q in found.results}
    assert by_name["coulomb_friction"].value == pytest.approx(1.2, rel=0.03)
    assert by_name["viscous_friction"].value == pytest.approx(2.0, rel=0.05)
    assert by_name["lost_motion"].value == pytest.approx(1e-3, rel=0.05)
    assert by_name["backlash"].value == pytest.approx(2e-3, rel=0.15)
    placed = {e.effect: e for e in joint.effects("joint1", found)[0]}
    assert set(placed) == {"coulomb_friction", "viscous_friction", "backlash"}
    q = by_name["coulomb_friction"]
    assert (placed["coulomb_friction"].params["torque"].low, placed["coulomb_friction"].params["torque"].high) == (
        q.low,
        q.high,
    )


def test_a_number_beyond_an_effects_bounds_is_noted_and_the_others_have_theirs():
    """Of a hobby servo: 40 ms of delay and 0.4 N m at most."""
    found = {"coulomb_friction": 0.1, "torque_limit": 0.4, "servo_gain": 1.0, "servo_natural_frequency": 30.0}
    found |= {"servo_damping_ratio": 0.7, "servo_delay": 0.04}
    results = [Quantity(name, v, "", 0.0, None, 2.0, 0.99 * v, 1.01 * v, "gum") for name, v in found.items()]
    of_servo = replace(answered(parts()["steps-50mrad"]), servo=True)
    effects, notes = joint.effects("elbow", joint.Joint([of_servo], results=results))
    assert {e.effect for e in effects} == {"coulomb_friction", "servo"}
    assert [note.partition(": ")[2].partition(":")[0] for note in notes] == ["torque_limit", "command_delay"]


def test_intervals_of_friction_hold_the_truth():
    held = 0
    for seed in range(10):
        trace = dragged(parts()["ladder"], gap=0.0, noise=2.0, seed=seed)
        by_name = {q.quantity: q for q in joint.measure([trace], rng()).results}
        held += by_name["coulomb_friction"].low <= 1.2 <= by_name["coulomb_friction"].high
    assert held >= 8


def test_a_load_that_holds_the_teeth_hides_the_gap():
    motions = parts()
    found = joint.measure([dragged(motions["triangle"], load=4.0)], rng())
    assert "backlash" not in {q.quantity for q in found.results}
    assert any("keeps the teeth on one side" in note for note in found.notes)


def test_a_load_without_a_sign_is_no_torque():
    trace = dragged(parts()["ladder"])
    found = joint.measure([Trace("t", trace.time, trace.q_cmd, trace.q, np.abs(trace.tau))], rng())
    assert "coulomb_friction" not in {q.quantity for q in found.results}
    assert any("no sign" in note for note in found.notes)


def test_an_arm_in_mujoco_with_the_actuator_makes_the_steps_of_the_size_held_out():
    """The written element in the iiwa's own model, the other joints held: beside the servo that was measured."""
    robot = load("iiwa14")
    posture = np.array([0.0, 0.5, 0.0, -1.2, 0.0, 0.9, 0.0])
    traces = [
        answered(p, seed=k) for k, p in enumerate(parts().values()) if p.name in ("steps-20mrad", "steps-100mrad")
    ]
    servo = steps.mean_servo([s for t in traces for s in steps.fitted(t)])
    held = answered(parts()["steps-50mrad"], noise=0.0)
    loop, _ = alone(servo, about(robot, posture)[0][0, 0])
    xml = element(loop, "joint1").split('"')
    said = dict(zip([w.strip(" =").split()[-1] for w in xml[:-1:2]], xml[1::2], strict=True))
    spec = robot.spec()
    spec.option.gravity, spec.option.timestep = (0, 0, 0), 1e-3
    for name in robot.joints[1:]:
        spec.joint(name).armature = 1e6  # held
    motor = spec.actuator("joint1")
    motor.gainprm[:3] = [float(x) for x in said["gainprm"].split()]
    motor.biasprm[:3] = [float(x) for x in said["biasprm"].split()]
    motor.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    motor.delay, motor.nsample = float(said["delay"]), int(said["nsample"])
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:] = posture
    got = np.empty(2000)
    for k in range(2000):
        got[k] = data.qpos[0]
        data.ctrl[model.actuator("joint1").id] = held.q_cmd[k]
        mujoco.mj_step(model, data)
        mujoco.mj_step(model, data)
    assert np.sqrt(np.mean((got - held.q[:2000]) ** 2)) < 0.02 * 0.05
    beside = simulated(servo, held.q_cmd[:2000], 1 / RATE)
    assert np.sqrt(np.mean((beside - got) ** 2)) < 0.01 * 0.05


def test_steps_that_answer_otherwise_later_are_refused():
    motion = parts()["steps-100mrad"]
    later = answered(motion, Servo(0.97, 27.0, 0.6, 0.012), seed=2, name="steps-again")
    with pytest.raises(UserError, match="natural_frequency.* has drifted between steps-100mrad and steps-again"):
        joint.measure([answered(motion, seed=1), later], rng())


def test_motions_of_the_plan_stay_in_range_and_show_what_they_say(tmp_path):
    robot = load("iiwa14")
    for part in plan(robot, "joint4", -1.2, 0.1, RATE, rng()):
        assert np.abs(part.offset).max() <= 0.9 * (2.09 - 1.2)
        assert part.offset[0] == pytest.approx(0.0, abs=1e-9)
        speed = np.diff(part.offset) * RATE
        if "steps" not in part.name:
            assert np.abs(speed).max() <= 0.5 * robot.velocity_limit[3] + 1e-9
        (tmp_path / "m.csv").write_text(table(part, robot.joints, np.full(7, 0.1), "joint4"))
        back = from_table(tmp_path / "m.csv", {"time": "time", "q_cmd": "q_cmd.joint4", "q": "q_cmd.joint3"})
        assert np.allclose(back.q_cmd, 0.1 + part.offset) and np.all(back.q == 0.1)
    ladder = next(p for p in plan(robot, "joint4", -1.2, 0.1, RATE, rng()) if p.name == "ladder")
    speeds = sorted({round(v, 4) for _, _, v in strokes(Trace("t", ladder.time, ladder.offset, ladder.offset))})
    assert speeds[0] == 0.004 and len(speeds) == 7


def test_a_shell_reads_the_order_as_it_is_meant_also_with_blanks_in_names(tmp_path):
    out = tmp_path / "my plan"
    made = plan_joint("joint4", out)
    block = "\n".join(line for line in made.order.splitlines() if line.startswith("    "))
    shell = ["bash", "-c", f"vispeg() {{ printf '%s|' \"$@\"; echo; }}\n{block}"]
    said = subprocess.run(shell, cwd=tmp_path, capture_output=True, text=True, check=True).stdout
    *records, measure = [line.split("|")[:-1] for line in said.splitlines()]
    assert [r[:4] for r in records] == [["record", "iiwa14", "--motion", str(out / n)] for n in made.names]
    assert [r[-2:] for r in records] == [["--out", f"runs/{n.removesuffix('.csv')}"] for n in made.names]
    assert measure[-4:] == ["--joint", "joint4", "--out", "joint4"]


def test_a_step_that_does_not_fit_names_what_is_wrong():
    """A joint at the end of its range can take no step, however small, so the posture is wrong and not the size."""
    robot = load("iiwa14")
    with pytest.raises(UserError, match="posture: joint1 has no room to move both ways"):
        plan(robot, "joint1", float(robot.range[0, 1]), 0.1, RATE, rng())
    for size in (0.0, 9.0):
        with pytest.raises(UserError, match="size: not a possible step"):
            plan(robot, "joint1", 0.0, size, RATE, rng())


def test_a_table_in_degrees_is_refused(tmp_path):
    t = np.arange(500) / RATE
    rows = np.stack([t, 20 * np.sin(t), 20 * np.sin(t)], axis=1)
    (tmp_path / "m.csv").write_text("t,goal,angle\n" + "\n".join(",".join(map(repr, row)) for row in rows.tolist()))
    with pytest.raises(UserError, match="m.csv: row .*, column angle: looks like degrees; expected radians"):
        from_table(tmp_path / "m.csv", {"time": "t", "q_cmd": "goal", "q": "angle"})


def test_what_shows_nothing_is_said():
    t = np.arange(500) / RATE
    with pytest.raises(UserError, match="show nothing of a joint"):
        joint.measure([Trace("still", t, np.zeros(500), np.zeros(500))], rng())


def wrong(change):
    """A recording of steps with its columns changed: (time, q_cmd, q) -> the same."""
    good = answered(parts()["steps-100mrad"])
    rows = slice(0, 4500)
    return Trace("log", *change(good.time[rows], good.q_cmd[rows], good.q[rows]))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda t, u, q: (t, u, 1e-5 * rng().standard_normal(len(q))), "the angle does not follow its command"),
        (lambda t, u, q: (t, u, 0.0 * q), "the angle does not follow its command"),
        (lambda t, u, q: (t, u, -q), "is opposite to its command"),
        (lambda t, u, q: (t, np.degrees(u), q), "likely degrees in q_cmd"),
        (lambda t, u, q: (t, u, np.degrees(q)), "likely degrees in q"),
        (lambda t, u, q: (t, q, u), "moves before its command.*swapped"),
    ],
)
def test_what_no_servo_does_is_refused_in_one_line(change, said):
    with pytest.raises(UserError, match=f"log: q: .*{said}") as refused:
        joint.measure([wrong(change)], rng())
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(("share", "refused"), [(0.48, True), (0.52, False), (1.9, False), (2.1, True)])
def test_less_than_half_and_more_than_twice_of_the_command_are_no_servo(share, refused):
    trace = answered(parts()["steps-100mrad"], replace(TRUE, gain=share))
    if refused:
        with pytest.raises(UserError, match="does not follow its command"):
            refuse_no_servo([trace], "log")
    else:
        refuse_no_servo([trace], "log")


@pytest.mark.parametrize("name", ["sines-large", "triangle", "ladder", "sweep"])
def test_every_motion_tells_whether_the_columns_are_swapped(name):
    t = np.arange(0, 30, 1 / RATE)
    part = type(parts()["triangle"])("sweep", "", t, 0.05 * signal.chirp(t, 0.2, 30, 8.0))
    trace = answered({**parts(), "sweep": part}[name])
    refuse_no_servo([trace], "log")
    with pytest.raises(UserError, match="before its command"):
        refuse_no_servo([Trace("log", trace.time, trace.q, trace.q_cmd)], "log")


@pytest.mark.parametrize(
    ("factor", "seconds", "said"),
    [
        (1e3, 9, "time: too slow, or times of another unit; expected a row every 0.1 s"),
        (1e6, 9, "time: too slow, or times of another unit"),
        (1.0, 1, "show nothing of a joint"),
        (1.0, 0.01, "not a motion"),
    ],
)
def test_times_of_another_unit_and_short_logs_are_one_line(factor, seconds, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    good = answered(parts()["steps-100mrad"])
    rows = zip(factor * good.time, good.q_cmd, good.q, strict=True)
    head = [",".join(map(repr, map(float, row))) for row in rows][: round(seconds * RATE)]
    (tmp_path / "log.csv").write_text("\n".join(["t,goal,angle", *head]) + "\n")
    argv = ["measure", "joint", "log.csv", "--columns", "time=t", "q_cmd=goal", "q=angle", "--out", "out"]
    assert main(argv) == 2
    err = capsys.readouterr().err
    assert re.search(said, " ".join(err.split())) and "Traceback" not in err and not (tmp_path / "out").exists()


def test_commands_that_are_logged_late_are_found_as_delay_and_leave_the_servo_alone():
    traces = [answered(p, seed=k) for k, p in enumerate(parts().values()) if p.name.startswith("steps")][:2]
    rows = round(0.02 * RATE)
    late = [Trace(t.name, t.time, np.concatenate([t.q_cmd[:1].repeat(rows), t.q_cmd[:-rows]]), t.q) for t in traces]
    found = joint.measure(late, rng())
    by_name = {q.quantity: q for q in found.results}
    for name in ("gain", "natural_frequency", "damping_ratio"):
        assert by_name[name].value == pytest.approx(getattr(TRUE, name), rel=0.01)
    assert by_name["delay"].low <= TRUE.delay - 0.02 <= by_name["delay"].high < 0
    assert any("answers 8 ms before its steps" in note for note in found.notes)
