"""What is written is read back, bit for bit."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from made import recording

from vispeg.core.errors import UserError
from vispeg.formats.yaml_data import read_yaml
from vispeg.recordings.load import load
from vispeg.recordings.recording import Control, Nullspace, Recording
from vispeg.recordings.write import write


def same(a, b) -> bool:
    if isinstance(a, np.ndarray):
        return isinstance(b, np.ndarray) and a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
    if dataclasses.is_dataclass(a):
        return all(same(getattr(a, f.name), getattr(b, f.name)) for f in dataclasses.fields(a))
    return type(a) is type(b) and a == b


def differences(a: Recording, b: Recording) -> list[str]:
    names = [f.name for f in dataclasses.fields(Recording) if f.name != "path"]
    return [name for name in names if not same(getattr(a, name), getattr(b, name))]


@pytest.mark.parametrize("table", ["csv", "parquet"])
@pytest.mark.parametrize("mode", ["torque", "position", "osc", "passive", "unknown"])
def test_every_mode_returns_bit_for_bit(tmp_path, table, mode):
    rec = recording(200, mode=mode, episode=np.arange(200) // 50)
    if mode == "osc":
        control = Control(
            "osc", 1000.0, "none", np.full(6, 1 / 3), np.ones(6), Nullspace(10.0, 0.1, np.array([1 / 3, 0.0]))
        )
        tool = {"mass_kg": 0.7, "com_m": [0.0, 0.0, 1 / 30], "inertia_kgm2": [1e-3, 2e-3, 3e-3], "name": "gripper: a"}
        rec = dataclasses.replace(
            rec, control=control, tool=tool, base_tilt=(0.1 / 3, -0.2), notes='tilted: "yes"\n#2 é'
        )
    assert differences(rec, load(write(rec, tmp_path / "r", table=table))) == []


@pytest.mark.parametrize("table", ["csv", "parquet"])
def test_missing_readings_stay_missing_and_extremes_survive(tmp_path, table):
    rec = recording(50)
    rec.q[3, 1] = np.nan
    rec.dq[:] = np.nan
    rec.ft[0] = [5e-324, -0.0, 1.7976931348623157e308, 1e22, 0.1 + 0.2, -1e-7]
    back = load(write(rec, tmp_path / "r", table=table))
    assert np.array_equal(np.isnan(back.q), np.isnan(rec.q)) and np.isnan(back.dq).all()
    assert same(np.nan_to_num(rec.q), np.nan_to_num(back.q)) and same(rec.ft, back.ft)


def test_a_robot_file_is_found_again_beside_the_recording(tmp_path):
    robot = tmp_path / "arm.urdf"
    robot.write_text("<robot/>")
    rec = recording(20, robot=str(robot))
    folder = write(rec, tmp_path / "runs" / "one")
    assert "robot: ../../arm.urdf" in (folder / "recording.yaml").read_text()
    assert load(folder).robot == str(robot.resolve())


def test_nothing_is_overwritten_unless_asked(tmp_path):
    rec = recording(20)
    write(rec, tmp_path / "r")
    before = (tmp_path / "r" / "samples.csv").read_bytes()
    with pytest.raises(UserError, match="exists"):
        write(recording(30), tmp_path / "r")
    assert (tmp_path / "r" / "samples.csv").read_bytes() == before
    write(recording(30), tmp_path / "r", overwrite=True, table="parquet")
    assert {p.name for p in (tmp_path / "r").iterdir()} == {".vispeg.json", "recording.yaml", "samples.parquet"}
    assert [p.name for p in tmp_path.iterdir()] == ["r"]


def test_a_failed_write_leaves_nothing(tmp_path):
    with pytest.raises(UserError, match="wrong shape"):
        write(recording(20, q=np.zeros((19, 2))), tmp_path / "r")
    assert list(tmp_path.iterdir()) == []


def test_what_is_not_known_of_a_controller_is_not_stated(tmp_path):
    """A log of an unknown controller says neither how gravity was held nor that there was no tool."""
    rec = recording(30, control=Control("unknown", 100.0), torque_sensor="joint", tau_cmd=None, q_cmd=None, dq_cmd=None)
    write(rec, tmp_path / "rec")
    head = read_yaml(tmp_path / "rec" / "recording.yaml")
    assert "gravity_compensation" not in head["control"] and "tool" not in head
    assert load(tmp_path / "rec").control == rec.control
