"""`vispeg diagnose`: killed and given again it ends as if nothing had happened; what changed is not reused."""

import json
from pathlib import Path

import numpy as np
import pytest
from loops import drive, hinge, pendulum, recorded

from vispeg.cli.usage import parsed
from vispeg.core.seeds import stream
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.selection.search import Search
from vispeg.recordings.write import write
from vispeg.report.text.terminal import written_lines

COMMAND = ["--recording", "a", "--recording", "b", "--validate", "c", "--quiet", "--threads", "1"]


@pytest.fixture
def swings(tmp_path):
    """Writes a pendulum with dry friction on three swings; returns the file of the model without."""

    def write_all(seed: int = 3, swing: float = 0.4) -> str:
        robot = pendulum()
        for i, name in enumerate("abc"):
            t = np.arange(600) * 5e-3
            q = swing * (1 - np.cos(2 * np.pi * (0.7 + 0.25 * i) * t))[:, None]
            s = drive(robot, "position", q[0], command=q, seconds=3.0, rate=200.0, kp=60.0, kd=4.0)
            rec = recorded(robot, robot.source, hinge("coulomb_friction", torque=0.8), s, stream(seed, i))
            write(rec, tmp_path / name, overwrite=True)
        return robot.source

    return write_all


@pytest.fixture
def worked_out(monkeypatch):
    """How many questions diagnoses had to work out themselves since it was last asked."""
    count = []
    real = Progress.recall

    def counted(self, question, work_out):
        return real(self, question, lambda: (count.append(1), work_out())[1])

    monkeypatch.setattr(Progress, "recall", counted)

    def since() -> int:
        n = len(count)
        count.clear()
        return n

    return since


def found(out: Path) -> dict:
    return {k: v for k, v in json.loads((out / "diagnosis.json").read_text()).items() if k != "provenance"}


def interrupt(*_, **__):
    raise KeyboardInterrupt


def test_interrupted_after_its_first_effect_it_goes_on(vispeg, swings, worked_out, tmp_path, monkeypatch):
    robot = swings()
    assert vispeg("diagnose", robot, *COMMAND, "--out", "whole")[0] == 0
    asked = worked_out()
    with monkeypatch.context() as patched:
        patched.setattr(Search, "settle", interrupt)
        assert vispeg("diagnose", robot, *COMMAND, "--out", "d")[0] == 130
    first = worked_out()
    assert 0 < first <= asked
    assert not (tmp_path / "d").exists() and (tmp_path / "d.part" / "progress.json").is_file()
    assert vispeg("diagnose", robot, *COMMAND, "--out", "d")[0] == 0
    assert worked_out() == asked - first
    assert found(tmp_path / "d") == found(tmp_path / "whole") and found(tmp_path / "d")["effects"]
    assert not [p.name for p in tmp_path.iterdir() if "part" in p.name]


@pytest.mark.slow
def test_with_other_inputs_it_begins_anew(vispeg, swings, worked_out, tmp_path, monkeypatch):
    robot = tmp_path / "arm.xml"
    robot.write_text(Path(swings()).read_text())
    monkeypatch.setattr(Search, "fits", interrupt)  # screened, nothing fitted

    def asked() -> int:
        assert vispeg("diagnose", robot, *COMMAND, "--out", "d")[0] == 130
        return worked_out()

    assert asked() == 1
    assert asked() == 0
    swings(seed=4)
    assert asked() == 1
    assert asked() == 0
    robot.write_text(robot.read_text().replace('mass="2.0"', 'mass="2.1"'))
    assert asked() == 1


def test_several_recordings_after_one_flag_are_several():
    """What a shell makes of `rig-*` is what the flag repeated is."""
    each = ["arm.xml", *COMMAND, "--out", "d"]
    together = ["arm.xml", "--recording", "a", "b", "--validate=c", "--quiet", "--threads", "1", "--out", "d"]
    assert parsed("diagnose", together) == parsed("diagnose", each)


def test_one_recording_judges_on_its_own_end(vispeg, swings, refused, tmp_path):
    robot = swings()
    refused(["diagnose", robot, "--recording", "a", "--out", "d", "--quiet"], "--validate", "--hold-out 0.3")
    command = ["diagnose", robot, "--recording", "a", "--hold-out", "0.3", "--quiet", "--threads", "1"]
    assert vispeg(*command, "--out", "d")[0] == 0
    record = found(tmp_path / "d")
    assert [e["effect"] for e in record["effects"]] == ["coulomb_friction"]
    assert record["ladder"][-1]["heldout_error"] < 0.1 * record["ladder"][0]["heldout_error"]
    refused([*command, "--validate", "c", "--out", "e"], "--hold-out: cannot be combined with --validate")


def test_the_next_motions_file_is_named_where_it_was_written(tmp_path):
    record = {"next_experiment": {"motion": "chirp", "why": "separates", "file": "next_experiment/samples.csv"}}
    motion = tmp_path / "next_experiment/samples.csv"
    report = f"report: {tmp_path / 'report.html'}"
    assert [line.text for line in written_lines(record, tmp_path)] == [report]
    motion.parent.mkdir()
    motion.write_text("time\n")
    assert [line.text for line in written_lines(record, tmp_path)] == [f"next motion: {motion}", report]
    assert [line.text for line in written_lines({"next_experiment": None}, tmp_path)] == [report]
