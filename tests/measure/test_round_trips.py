"""What is hidden in a simulated joint, recorded, measured and put into the model makes the recording again."""

import numpy as np
import pytest

from vispeg.api.measure.joint import measure_joint
from vispeg.api.recording.record import record
from vispeg.identify.record import centre_of
from vispeg.robots.model import load
from vispeg.worlds.measurement_file import load_measurement

HOW = {"control": "servo", "torque_sensor": "none", "noise": {"q": 2e-5}}  # rad
RATE = 500.0


def motion(path, size, joint, hold=0.7):
    """Steps of one size both ways, as those of `measure plan`."""
    offset = np.repeat([0.0, size, 0.0, -size, 0.0], round(hold * RATE))
    return commanded(path, offset, joint, np.zeros(len(offset)))


def ways(path, joint, reach, speeds):
    """Ways out and back to both sides, twice at each speed, as the triangles and the ladder of `measure plan`."""
    parts = [np.zeros(250)]
    for speed in speeds:
        x = np.linspace(0.0, 1.0, round(reach / speed * RATE), endpoint=False)
        parts.append(reach * np.tile(np.concatenate([x, 1 - x, -x, x - 1]), 2))
    offset = np.concatenate([*parts, np.zeros(250)])
    return commanded(path, offset, joint, np.gradient(offset, 1 / RATE))


def commanded(path, offset, joint, speed):
    robot = load("iiwa14")
    q = np.tile(centre_of(robot), (len(offset), 1))
    dq = np.zeros_like(q)
    q[:, robot.joints.index(joint)] += offset
    dq[:, robot.joints.index(joint)] = speed
    head = ",".join(["time", *(f"q_cmd.{n}" for n in robot.joints), *(f"dq_cmd.{n}" for n in robot.joints)])
    rows = np.column_stack([np.arange(len(offset)) / RATE, q, dq])
    np.savetxt(path, rows, delimiter=",", header=head, comments="", fmt="%.9g")
    return path


def recorded(folder, effects, joint, sizes=(0.1, 0.04), hold=0.7, **how):
    paths = []
    for size in sizes:
        name = f"s{1e3 * size:.0f}"
        file = motion(folder / f"{name}.csv", size, joint, hold)
        record("iiwa14", file, effects=effects, name=name, **HOW | how).save(folder / name)
        paths.append(folder / name)
    return paths


@pytest.mark.parametrize("torque", [0.3, *(pytest.param(t, marks=pytest.mark.slow) for t in (0.0, 1.5))])
def test_a_servo_survives_the_round_trip(torque, tmp_path):
    """Beside no dry friction, a little and much: numbers, intervals, and the replay, whose error is noise."""
    truth = ["servo:joint1:natural_frequency=25,damping_ratio=0.7"]
    truth += [f"coulomb_friction:joint1:torque={torque}"] * (torque > 0)
    paths = recorded(tmp_path, truth, "joint1", hold=1.5)  # s, as the plan holds: without friction it swings for long
    measure_joint(paths, tmp_path / "found", joint="joint1")
    found = load_measurement(tmp_path / "found" / "measurement.yaml")
    by_name = {q.quantity: q for q in found.results}
    hidden = {"natural_frequency": 25.0, "damping_ratio": 0.7, "gain": 1.0, "delay": 0.0}
    for name, value in hidden.items():
        assert by_name[f"servo_{name}"].low <= value <= by_name[f"servo_{name}"].high, name
        assert by_name[f"servo_{name}"].value == pytest.approx(value, rel=0.002, abs=2e-4)
    # what the arm answers like without friction, recorded at 2 kHz
    for name, value in {"natural_frequency": 15.3976, "damping_ratio": 0.43718, "gain": 0.99935}.items():
        assert by_name[name].value == pytest.approx(value, rel=0.002), name
    assert {e.effect for e in found.effects} == {"servo", *["coulomb_friction"] * (torque > 0)}
    # the file of MuJoCo has the same loop, and the same friction beside it
    text = (tmp_path / "found" / "actuator.xml").read_text()
    stiffness, damping = (float(x) for x in text.split('biasprm="0 -')[1].split('"')[0].split(" -"))
    assert stiffness == pytest.approx(by_name["loop_stiffness"].value, rel=1e-6)
    assert damping == pytest.approx(by_name["loop_damping"].value, rel=1e-6)
    if torque:
        friction = next(e for e in found.effects if e.effect == "coulomb_friction").params["torque"]
        assert friction.low <= torque <= friction.high and friction.value == pytest.approx(torque, rel=0.01)
        assert f'frictionloss="{friction.value:.6g}"' in text
    between = motion(tmp_path / "s60.csv", 0.06, "joint1")
    q = [record("iiwa14", between, effects=e, **HOW).recording.q[:, 0] for e in (truth, list(found.effects), [])]
    rms = [float(np.sqrt(np.mean((x - q[0]) ** 2))) for x in q[1:]]
    assert rms[0] < 0.01 * rms[1] and rms[0] < 3e-5  # rad; two noises are 3e-5


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effect", "name", "value"), [("torque_limit", "limit", 25.0), ("torque_speed_limit", "stall", 60.0)]
)
def test_a_limit_of_torque_survives_the_round_trip_and_its_steps_are_left_out(effect, name, value, tmp_path):
    how = {"control": "position", "torque_sensor": "motor"}
    truth = [f"{effect}:joint1:{name}={value}" + (",no_load=2" if name == "stall" else "")]
    paths = recorded(tmp_path, truth, "joint1", sizes=(0.1, 0.02), **how)
    found = measure_joint(paths, tmp_path / "found", joint="joint1").measurement
    placed = [e for e in found.effects if e.effect == effect]
    assert len(placed) == 1
    for key, true in {name: value, **({"no_load": 2.0} if name == "stall" else {})}.items():
        got = placed[0].params[key]
        assert got.low <= true <= got.high and got.value == pytest.approx(true, rel=0.05)
    assert any("steps of 0.1 rad reach the torque limit: they are left out" in note for note in found.notes)
    assert any("falls with the speed" in note for note in found.notes) == (name == "stall")
    assert {abs(round(row["size_rad"], 3)) for row in found.details["steps"]} == {0.02}
    between = motion(tmp_path / "s90.csv", 0.09, "joint1")
    q = [record("iiwa14", between, effects=e, **HOW | how).recording.q[:, 0] for e in (truth, placed, [])]
    rms = [float(np.sqrt(np.mean((x - q[0]) ** 2))) for x in q[1:]]
    assert rms[0] < 0.1 * rms[1]  # the row of time between torque and angle is in the interval of the falling one
    alone = measure_joint(paths[1:], tmp_path / "small", joint="joint1").measurement
    assert not {"torque_limit", "stall_torque"} & {q.quantity for q in alone.results}
    assert any("no torque limit shows: the motor gave" in note for note in alone.notes)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("truth", "reach", "speeds"),
    [
        # the gap shows where friction holds the teeth together on both sides, at 0.015 rad/s and slower
        ({"backlash": ("gap", 0.002), "coulomb_friction": ("torque", 1.5)}, 0.02, (0.01, 0.015)),
        ({"viscous_friction": ("damping", 10.0)}, 0.25, (0.05, 0.2, 0.5)),
    ],
    ids=["backlash", "viscous friction"],
)
def test_backlash_and_friction_survive_the_round_trip(truth, reach, speeds, tmp_path):
    """Their intervals hold a row of time between angle and torque and an angle of smoothing: no chance misses them."""
    how = HOW | {"control": "position", "torque_sensor": "motor"}
    hidden = [f"{effect}:joint1:{key}={value}" for effect, (key, value) in truth.items()]
    file = ways(tmp_path / "ways.csv", "joint1", reach, speeds)
    record("iiwa14", file, effects=hidden, **how).save(tmp_path / "ways")
    found = measure_joint([tmp_path / "ways"], tmp_path / "found", joint="joint1").measurement
    placed = {e.effect: e for e in found.effects}
    assert set(placed) == set(truth)
    for effect, (key, value) in truth.items():
        got = placed[effect].params[key]
        assert got.low <= value <= got.high and got.value == pytest.approx(value, rel=0.05)
    between = ways(tmp_path / "between.csv", "joint1", 0.9 * reach, [1.2 * speeds[-1]])
    q = [record("iiwa14", between, effects=e, **how).recording.q[:, 0] for e in (hidden, list(placed.values()), [])]
    rms = [float(np.sqrt(np.mean((x - q[0]) ** 2))) for x in q[1:]]
    assert rms[0] < 0.1 * rms[1] and rms[0] < 1e-4  # rad; two noises are 3e-5
