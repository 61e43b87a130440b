"""Files for the Rerun viewer hold what was measured and played, read back by Rerun's own reader.

The reader comes with the extra `viz`; without it these tests are skipped, but for the arm's kinematics.
"""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from vispeg.core.errors import UserError
from vispeg.core.seeds import stream as rng_of
from vispeg.evaluation.entrants import entrant
from vispeg.report.evidence import Evidence, Trace
from vispeg.report.live.arm import arm_arrays, picked
from vispeg.report.rrd.comparison import posed, write_comparison
from vispeg.report.rrd.episode import placed, played, write_episodes
from vispeg.report.rrd.stream import check_target
from vispeg.robots.model import load
from vispeg.sim.compiled import compiled
from vispeg.worlds.world import World


@pytest.fixture(scope="module")
def arm():
    world = World()
    joints = load(world.robot).joints
    return picked(arm_arrays(world, joints)), joints, compiled(load(world.robot))


def chunks(path):
    """Entity -> column -> (times s, values) of a file."""
    reader = pytest.importorskip("rerun.chunk").RrdReader(path)
    found = {}
    for chunk in reader.stream().to_chunks():
        batch = chunk.to_record_batch()
        names = batch.schema.names
        time = np.array(batch.column("time").cast("int64")) / 1e9 if "time" in names else None
        for name in names:
            if ":" in name:
                entity = chunk.entity_path.replace("\\", "")
                times, values = found.setdefault(entity, {}).setdefault(name, ([], []))
                times.extend([] if time is None else time)
                values.extend(batch.column(name).to_pylist())
    return found


def numbers(found, entity, column="Scalars:scalars"):
    times, values = found[entity][column]
    order = np.argsort(times, kind="stable")
    return np.array(times)[order], np.squeeze(np.array(values, float), axis=1)[order]


def test_the_arms_kinematics_are_those_of_mujoco(arm):
    arrays, joints, model = arm
    q = rng_of(0, "poses").uniform(-2, 2, (20, len(joints)))
    pos, quat = posed(arrays, q)
    data = mujoco.MjData(model)
    for t, angles in enumerate(q):
        for j, name in enumerate(joints):
            data.qpos[model.jnt_qposadr[model.joint(name).id]] = angles[j]
        mujoco.mj_kinematics(model, data)
        assert np.abs(pos[t] - data.xpos).max() < 1e-9
        same = np.abs(np.sum(quat[t] * data.xquat, axis=1))
        assert same == pytest.approx(1.0, abs=1e-9), "equal but for the sign"


def test_a_comparison_holds_every_reading_and_residual_and_both_arms(arm, tmp_path):
    pytest.importorskip("rerun")
    arrays, joints, _ = arm
    rng = rng_of(1, "trace")
    time = np.arange(50) / 100.0
    measured = rng.uniform(-1, 1, (50, len(joints)))
    model = measured + rng.normal(0, 0.01, measured.shape)
    measured[10:13, 2] = np.nan
    trace = Trace("rig/a 1", "rad", time, measured, model, None)
    file = write_comparison(tmp_path / "c.rrd", "compare", Evidence(tuple(joints), "rad", (trace,), arm=arrays))
    assert [p.name for p in tmp_path.iterdir()] == ["c.rrd"]
    found = chunks(file)
    for j, joint in enumerate(joints):
        there = np.isfinite(measured[:, j])
        for line, truth in (("measured", measured), ("model", model)):
            at, values = numbers(found, f"/rig/a 1/rad/{joint}/{line}")
            keep = there if line == "measured" else np.ones(50, bool)
            assert at == pytest.approx(time[keep]) and np.array_equal(values, truth[keep, j])
        at, left = numbers(found, f"/rig/a 1/residual rad/{joint}/measured - model")
        assert np.array_equal(left, (measured - model)[there, j])
    whole = np.isfinite(measured).all(axis=1)
    pos, _ = posed(arrays, measured[whole])
    last = int(arrays["body"].max())
    at, places = numbers(found, f"/rig/a 1/arm/measured/body{last}", "Transform3D:translation")
    assert at == pytest.approx(time[whole]) and places == pytest.approx(pos[:, last], abs=1e-6)
    ghost, _ = posed(arrays, model)
    assert numbers(found, f"/rig/a 1/arm/model/body{last}", "Transform3D:translation")[1] == pytest.approx(
        ghost[:, last], abs=1e-6
    )
    shape = found[f"/rig/a 1/arm/measured/body{last}"]["Mesh3D:vertex_positions"][1][0]
    assert np.array(shape) == pytest.approx(arrays["vertex"][arrays["body"] == last], abs=1e-6)


def test_an_episode_holds_the_cell_the_forces_the_pictures_and_its_end(tmp_path):
    pytest.importorskip("rerun")
    (shown,) = played(entrant("expert"), "searching", {}, [1_000_003], "expert")
    seen = np.full((12, 16, 3), 200, np.uint8)
    steps = [replace(m, pictures={"rgb.wrist": seen}, estimate=m.offset + 0.5) for m in shown.moments]
    file = write_episodes(tmp_path / "e.rrd", "play", [replace(shown, moments=steps)])
    found = chunks(file)
    root, time = f"/{shown.name}", np.array([m.time for m in steps])
    pos, _ = placed(shown.model, steps)
    for name in ("link4", "link7"):
        at, places = numbers(found, f"{root}/cell/{name}", "Transform3D:translation")
        assert at == pytest.approx(time) and places == pytest.approx(pos[:, shown.model.body(name).id], abs=1e-6)
    force = np.stack([m.force for m in steps])
    tip = np.stack([m.offset for m in steps])
    for k, axis in enumerate("xyz"):
        assert np.array_equal(numbers(found, f"{root}/force N/{axis}")[1], force[:, k])
        assert numbers(found, f"{root}/tip mm/{axis} estimated")[1] - tip[:, k] == pytest.approx(0.5)
    assert found[f"{root}/outcome"]["TextLog:text"][1] == [[steps[-1].outcome]] and steps[-1].outcome
    assert len(found[f"{root}/sees/rgb.wrist"]["EncodedImage:blob"][1]) == len(steps)


def test_a_file_that_is_there_or_has_another_ending_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("vispeg.report.rrd.stream.require", lambda module, what: None)
    with pytest.raises(UserError, match=r"another ending.*FILE\.rrd"):
        check_target(tmp_path / "c.mp4", False)
    (tmp_path / "c.rrd").write_text("mine")
    with pytest.raises(UserError, match="exists already"):
        check_target(tmp_path / "c.rrd", False)
    check_target(tmp_path / "c.rrd", True)
    assert (tmp_path / "c.rrd").read_text() == "mine"
