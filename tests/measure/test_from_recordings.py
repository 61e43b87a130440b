"""Wrenches of a known tool, slide and press, in every convention that a header states: the same numbers come back."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vispeg.api.measure.quantity import measure_com, measure_friction
from vispeg.core.errors import UserError
from vispeg.measure import com
from vispeg.measure.from_recordings import at_rest, presses, slides
from vispeg.recordings.cell import WrenchSensor
from vispeg.recordings.recording import Control, Recording, in_order
from vispeg.recordings.write import write
from vispeg.robots.model import load
from vispeg.sim.compiled import flange_pose

RATE, POSTURES = 100.0, 6
MASS, CENTRE = 1.5, np.array([0.01, 0.02, 0.08])  # kg, m
ARM = load("iiwa14")
SENSORS = {
    "reaction": WrenchSensor(acts_on="flange"),
    "base": WrenchSensor(frame="base", pos=(0.01, 0.0, 0.05)),
    "raised": WrenchSensor(pos=(0.0, 0.0, 0.05)),
    "turned": WrenchSensor(quat=tuple(Rotation.from_euler("zx", [45, 90], degrees=True).as_quat(scalar_first=True))),
}
TRUTH = pytest.approx({"mass": MASS, "com_x": 0.01, "com_y": 0.02, "com_z": 0.08}, abs=1e-3)


def turns(q):
    return Rotation.from_quat(flange_pose(ARM, q)[:, 3:], scalar_first=True)


def recorded(q, wrench, sensor=None):
    """A recording of an iiwa with this wrench of the flange on the tool (n, 6), as the sensor reads it."""
    said = sensor or WrenchSensor()
    axes = Rotation.from_quat(said.quat, scalar_first=True)
    force, torque = wrench[:, :3], wrench[:, 3:] - np.cross(said.pos, wrench[:, :3])
    sign = 1 if said.acts_on == "tool" else -1
    to_sensor = turns(q) if said.frame == "base" else axes.inv()
    ft = sign * np.hstack([to_sensor.apply(force), to_sensor.apply(torque)])
    time = np.arange(len(q)) / RATE
    return Recording(Path("r"), "iiwa14", ARM.joints, RATE, Control("unknown", RATE), time, q, ft=ft, wrench=sensor)


def carried(sensor=None, last=None):
    """A tool held still for a second in each of six attitudes; `last` holds the last joint, rad."""
    r = np.random.default_rng(0)
    held = np.clip(0.6 + r.uniform(-0.9, 0.9, (POSTURES, 7)), ARM.range[:, 0] + 0.05, ARM.range[:, 1] - 0.05)
    held[:, 6] = held[:, 6] if last is None else last
    share = np.linspace(0, 1, 300)[:, None]
    ways = zip(held, np.roll(held, -1, axis=0), strict=True)
    q = np.concatenate([part for a, b in ways for part in (np.repeat(a[None], 100, 0), a + (b - a) * share)])
    q += 1e-5 * r.standard_normal(q.shape)
    force = turns(q).inv().apply([0.0, 0.0, 9.81 * MASS])
    wrench = np.hstack([force, np.cross(CENTRE, force)]) + 1e-3 * r.standard_normal((len(q), 6))
    return recorded(q, wrench, sensor)


def rubbed(sensor=None):
    """A second in free air; then joint 1 sweeps the flange there and back, 8 N on a plane and 2.4 N along it."""
    time = np.arange(0.0, 6.0, 1 / RATE)
    q = np.tile([0.0, 0.5, 0.0, -1.2, 0.0, 0.9, 0.0], (len(time), 1))
    q[:, 0] = np.interp(time, [0, 2, 3.5, 5, 6], [0.0, 0.0, 0.1, 0.0, 0.0])
    wrench = np.zeros((len(time), 6))
    wrench[:, 2] = np.interp(time, [0, 1.2, 1.8], [0.0, 0.0, -8.0])
    wrench[:, 1] = 2.4 * np.interp(time, [2, 2.1, 3.45, 3.55, 4.9, 5.0], [0, 1, 1, -1, -1, 0])
    return recorded(q, wrench, sensor)


def pushed(sensor=None):
    """A second in free air; then joint 4 moves the flange down and up, against a spring along the flange's z."""
    time = np.arange(0.0, 5.0, 1 / RATE)
    q = np.tile([0.0, 0.5, 0.0, -1.2, 0.0, 1.44, 0.0], (len(time), 1))
    q[:, 3] += np.interp(time, [0, 1.2, 3, 4.8], [0.0, 0.0, 0.02, 0.0])
    wrench = np.zeros((len(time), 6))
    wrench[:, 2] = -np.interp(time, [0, 1.2, 3, 4.8], [0.0, 0.0, 40.0, 0.0])
    return recorded(q, wrench, sensor)


def gapped(rec, joint):
    """The recording without every 25th reading of a joint."""
    q = rec.q.copy()
    q[12::25, joint] = np.nan
    return replace(rec, q=q)


def listed(rec, joints):
    """The recording with these joints of the iiwa, in this order."""
    return in_order(replace(rec, joints=ARM.joints[: len(joints)], q=rec.q[:, : len(joints)]), joints)


def found(rec, folder):
    readings = at_rest([write(rec, folder / "r")])
    outcome = com.attitudes(readings, np.random.default_rng(0))
    return {q.quantity: q.value for q in outcome.results}, len(readings), outcome.notes


@pytest.mark.parametrize("sensor", [None, *SENSORS.values()], ids=["none", *SENSORS])
def test_a_tool_at_rest_weighs_the_same_in_every_sensor_s_axes(sensor, tmp_path):
    assert found(carried(sensor), tmp_path) == (TRUTH, POSTURES, ())


def test_a_tool_at_rest_weighs_the_same_where_poses_come_less_often_than_wrenches(tmp_path):
    """Poses at 20 Hz, wrenches at 100 Hz."""
    rec = carried()
    seen = np.arange(len(rec.time))[:, None] % 5 == 0
    assert found(replace(rec, ee=np.where(seen, flange_pose(ARM, rec.q), np.nan)), tmp_path) == (TRUTH, POSTURES, ())


def test_rests_are_as_long_as_the_times_say(tmp_path):
    """A second at rest, whatever rate the header states."""
    assert found(replace(carried(), rate_hz=400.0), tmp_path) == (TRUTH, POSTURES, ())


def test_a_wrench_whose_weight_the_robot_subtracts_weighs_nothing_and_is_refused(tmp_path):
    with pytest.raises(UserError, match="wrench.tared: the robot has subtracted the tool's weight"):
        found(carried(WrenchSensor(tared="weight")), tmp_path)


TOOL = {"mass_kg": MASS, "com_m": CENTRE.tolist(), "inertia_kgm2": [1e-3, 1e-3, 1e-3]}


def becomes(tool, folder):
    """What a measurement of the carried tool writes, where the recording declares this tool."""
    held = write(replace(carried(), tool=tool), folder / "held")
    return measure_com(held, folder / "com.yaml").measurement


def test_a_load_that_the_recording_declares_is_no_payload(tmp_path):
    found = becomes(TOOL, tmp_path)
    assert {q.quantity: q.value for q in found.results} == TRUTH
    assert not found.effects and "the declared tool alone" in " ".join(found.notes)


def test_a_payload_is_what_the_flange_carries_beside_the_declared_tool(tmp_path):
    """A tool of 1 kg hangs 3 cm away from the whole load's centre: the other half kilogram balances it."""
    at = CENTRE + [0.03, 0.0, 0.0]
    found = becomes({**TOOL, "mass_kg": 1.0, "com_m": at.tolist()}, tmp_path)
    rest = (MASS * CENTRE - 1.0 * at) / (MASS - 1.0)
    (payload,) = found.effects
    for key, value in dict(zip(("mass", *"xyz"), (MASS - 1.0, *rest), strict=True)).items():
        got = payload.params[key]
        assert got.value == pytest.approx(value, abs=2e-3) and got.low < value < got.high
    assert {q.quantity: q.value for q in found.results} == TRUTH


def test_recordings_of_different_tools_are_no_measurement_of_one(tmp_path):
    a, b = (write(replace(carried(), tool=tool), tmp_path / name) for name, tool in (("a", None), ("b", TOOL)))
    with pytest.raises(UserError, match="a recording of another tool"):
        measure_com([a, b], tmp_path / "com.yaml")


def test_missing_angles_neither_make_rests_of_a_motion_nor_turn_the_flange(tmp_path):
    rec = gapped(carried(), 3)
    assert found(rec, tmp_path / "q")[:2] == (TRUTH, POSTURES)
    pose = flange_pose(ARM, carried().q)
    pose[:, 3:] *= np.random.default_rng(1).choice([-1.0, 1.0], (len(pose), 1))  # the same rotations
    pose[::25] = np.nan
    assert found(replace(rec, ee=pose), tmp_path / "ee")[:2] == (TRUTH, POSTURES)


def test_joints_in_another_order_and_joints_that_the_log_lacks_make_no_difference(tmp_path):
    assert found(listed(carried(), ARM.joints[::-1]), tmp_path / "reversed")[:2] == (TRUTH, POSTURES)
    assert found(listed(carried(last=0.0), ARM.joints[:6]), tmp_path / "six")[:2] == (TRUTH, POSTURES)


def test_joints_of_another_robot_are_refused(tmp_path):
    with pytest.raises(UserError, match="joints: .*not the robot's"):
        found(replace(carried(), joints=tuple("abcdefg")), tmp_path)


@pytest.mark.parametrize("sensor", SENSORS.values(), ids=SENSORS)
def test_forces_of_slides_and_presses_are_along_the_flange_and_not_the_sensor(sensor, tmp_path):
    for k, kind in enumerate((None, sensor)):
        rub, push = (write(make(kind), tmp_path / f"{make.__name__}-{k}") for make in (rubbed, pushed))
        slide, press = slides([rub]).columns, presses([push], [push]).columns
        assert slide["normal"] == pytest.approx([8.0, 8.0], rel=1e-3)
        assert slide["tangential"] == pytest.approx([2.4, 2.4], rel=1e-3)
        assert press["force"].max() == pytest.approx(40.0, rel=1e-3)


def test_a_slide_given_twice_is_not_two_slides(tmp_path):
    slide = write(rubbed(), tmp_path / "slide")
    with pytest.raises(UserError, match="slide: given twice"):
        measure_friction([slide, slide], tmp_path / "out.yaml")
    assert not (tmp_path / "out.yaml").exists()


def test_missing_readings_of_a_slide_and_a_press_are_bridged(tmp_path):
    whole = slides([write(rubbed(), tmp_path / "slide")]).columns
    rec = gapped(rubbed(), 1)
    rec.ft[::20, 2] = np.nan
    slide = slides([write(rec, tmp_path / "slide-gaps")]).columns
    assert slide == {name: pytest.approx(value, rel=1e-3) for name, value in whole.items()}
    paths = [write(rec, tmp_path / name) for name, rec in (("press", pushed()), ("gaps", gapped(pushed(), 3)))]
    press, gaps = (presses([path], [path]).columns["depth"] for path in paths)
    assert gaps == pytest.approx(press, abs=1e-5) and press.max() > 5e-3


def after(first, second):
    """Two recordings of one robot as the episodes of one file; time restarts in the second."""
    rows = {key: np.concatenate([getattr(r, key) for r in (first, second)]) for key in ("time", "q", "ft")}
    return replace(first, episode=np.repeat([0, 1], [len(first.time), len(second.time)]), **rows)


def drifted(rec):
    """The same motion from another place, after the sensor's zero has drifted by 3 N."""
    return replace(rec, q=rec.q + 0.2 * np.eye(7)[0], ft=rec.ft + [0.5, -0.5, 3.0, 0.0, 0.0, 0.0])


def test_episodes_measure_what_recordings_of_their_own_do(tmp_path):
    """Each episode of slides and presses has its own beginning in free air, depth of 0 and ramps."""
    for make, of in ((rubbed, slides), (pushed, lambda paths: presses(paths, paths))):
        alone = [
            of([write(rec, tmp_path / f"{make.__name__}-{k}")]).columns
            for k, rec in enumerate((make(), drifted(make())))
        ]
        both = of([write(after(make(), drifted(make())), tmp_path / f"{make.__name__}-both")]).columns
        for name in set(both) - {"ramp", "on"}:
            parts = [values[name] for values in alone]
            assert np.sort(both[name]) == pytest.approx(np.sort(np.concatenate(parts)), abs=1e-9), name
    assert set(both["ramp"]) == {0, 1, 2, 3}


def test_a_rest_does_not_go_on_from_one_episode_to_the_next(tmp_path):
    """Of four episodes, the arm rests for 0.3 s in each of the two that a rest of 0.6 s would join."""
    rec = carried()
    rows = np.r_[0:100, 400:430, 800:830, 1200:1300]
    number = np.repeat([0, 1, 2, 3], [100, 30, 30, 100])
    cut = replace(rec, time=rec.time[rows], q=rec.q[rows], ft=rec.ft[rows], episode=number)
    cut.q[100:160] = cut.q[100]
    assert len(at_rest([write(cut, tmp_path / "r")])) == 2


def test_a_wrench_that_begins_late_is_not_read_before(tmp_path):
    """A rest without a wrench weighs nothing; a slide whose first second was not measured has no zero."""
    rest, rub = carried(), rubbed()
    rest.ft[:110], rub.ft[:110] = np.nan, np.nan
    assert found(rest, tmp_path)[:2] == (TRUTH, POSTURES - 1)
    with pytest.raises(UserError, match="does not begin with 1 s in free air"):
        slides([write(rub, tmp_path / "slide")])
