"""A log becomes the recording that the command would write, with the units that the user confirmed."""

import numpy as np
import pytest

from vispeg.cli.main import main
from vispeg.core.errors import UserError
from vispeg.recordings.load import load
from vispeg.view.importing import Importer


def last(heard, name):
    return [value for at, value in heard if at == name][-1]


@pytest.fixture
def log(rigs, elbow, tmp_path):
    """The first recording as some other program would log it: milliseconds, degrees, names of its own."""
    rec = load(rigs / "rig-a")
    names = ["stamp_ms", "shoulder_pos", "elbow_pos"]
    table = np.column_stack([1e3 * rec.time, np.degrees(rec.q)])
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header=",".join(names), comments="", fmt="%.9g")
    return tmp_path / "log.csv"


def test_the_recording_is_the_command_s_and_has_the_measured_angles(rigs, log, tmp_path, elbow):
    heard = []
    made = Importer(lambda name, value: heard.append((name, value)))
    columns = {"time": {"column": "stamp_ms", "unit": "ms"}}
    columns |= {"q.shoulder": {"column": "shoulder_pos", "unit": "deg"}, f"q.{elbow}": {"column": "elbow_pos"}}
    columns[f"q.{elbow}"]["unit"] = "deg"
    robot = str(rigs / "arm.xml")
    made.look(log, robot, columns)
    look = last(heard, "look")
    assert look.rate_hz == 200 and look.samples == 600 and not look.doubts
    made.write(log, robot, columns, tmp_path / "rec")
    again = ["convert", log, "--robot", robot, "--map", tmp_path / "rec-map.yaml", "--out", tmp_path / "other"]
    assert main([str(word) for word in [*again, "--table", "parquet"]]) == 0
    one, other, source = load(tmp_path / "rec"), load(tmp_path / "other"), load(rigs / "rig-a")
    assert np.array_equal(one.q, other.q) and np.array_equal(one.time, other.time)
    assert np.allclose(one.q, source.q, atol=1e-8)
    with pytest.raises(UserError, match="exists already"):
        made.write(log, robot, columns, tmp_path / "rec")


def test_a_unit_that_cannot_be_true_is_doubted(rigs, log, elbow):
    heard = []
    made = Importer(lambda name, value: heard.append((name, value)))
    columns = {"time": {"column": "stamp_ms", "unit": "us"}}
    columns |= {"q.shoulder": {"column": "shoulder_pos", "unit": "deg"}}
    columns[f"q.{elbow}"] = {"column": "elbow_pos", "unit": "deg"}
    made.look(log, str(rigs / "arm.xml"), columns)
    assert any("2e+05 samples a second" in text for text in last(heard, "look").doubts)
