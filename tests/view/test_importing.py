"""A log becomes the recording that the command would write, with the units that the user confirmed."""

import re
import shlex
import time
from html import unescape

import numpy as np
import pytest
from logged import JOINTS, STYLES, TAU, TIME, Q, numbered, write_table

from vispeg.api.recording.convert import convert
from vispeg.api.recording.guess import propose
from vispeg.cli.main import main
from vispeg.core.errors import UserError
from vispeg.recordings.importers.mapping import FACTORS
from vispeg.recordings.load import load
from vispeg.view import html
from vispeg.view.import_page import NO_COLUMNS, NO_UNITS
from vispeg.view.importing import Importer, Proposed


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
    made.write(log, robot, columns, tmp_path / "rec", False)
    again = ["convert", log, "--robot", robot, "--map", tmp_path / "rec-map.yaml", "--out", tmp_path / "other"]
    assert main([str(word) for word in [*again, "--table", "parquet"]]) == 0
    one, other, source = load(tmp_path / "rec"), load(tmp_path / "other"), load(rigs / "rig-a")
    assert np.array_equal(one.q, other.q) and np.array_equal(one.time, other.time)
    assert np.allclose(one.q, source.q, atol=1e-8)
    with pytest.raises(UserError, match="exists already"):
        made.write(log, robot, columns, tmp_path / "rec", False)
    columns["time"]["unit"] = "s"
    made.write(log, robot, columns, tmp_path / "rec", True)  # what it wrote itself it replaces, map and all
    assert load(tmp_path / "rec").time[-1] == pytest.approx(1000 * one.time[-1])
    assert "unit: s" in (tmp_path / "rec-map.yaml").read_text()
    (tmp_path / "rec" / "mine.txt").touch()
    with pytest.raises(UserError, match=r"mine\.txt"):
        made.write(log, robot, columns, tmp_path / "rec", True)


def test_a_unit_that_cannot_be_true_is_doubted(rigs, log, elbow):
    heard = []
    made = Importer(lambda name, value: heard.append((name, value)))
    columns = {"time": {"column": "stamp_ms", "unit": "us"}}
    columns |= {"q.shoulder": {"column": "shoulder_pos", "unit": "deg"}}
    columns[f"q.{elbow}"] = {"column": "elbow_pos", "unit": "deg"}
    made.look(log, str(rigs / "arm.xml"), columns)
    assert any("2e+05 samples a second" in text for text in last(heard, "look").doubts)


def test_degrees_are_what_the_map_states_not_what_a_column_is_called(rigs, elbow, tmp_path):
    rec, heard = load(rigs / "rig-a"), []
    table = np.column_stack([rec.time, 0.02 * rec.q])  # hardly moves: as degrees it would be doubted
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header="time,was_deg_1,was_deg_2", comments="", fmt="%.9g")
    columns = {"time": {"column": "time"}}
    columns |= {f"q.{j}": {"column": f"was_deg_{k}", "unit": "rad"} for k, j in enumerate(("shoulder", elbow), 1)}
    Importer(lambda name, value: heard.append((name, value))).look(tmp_path / "log.csv", str(rigs / "arm.xml"), columns)
    assert not last(heard, "look").doubts


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """The page Import of a server that nobody looks at, and what it wrote."""
    viser = pytest.importorskip("viser", reason="the extra 'view' is not installed")
    from vispeg.view.gate import free_port
    from vispeg.view.import_page import ImportPage
    from vispeg.view.place import Place

    server = viser.ViserServer(host="127.0.0.1", port=free_port(None), verbose=False)
    written = []
    made = ImportPage(Place(server, tmp_path_factory.mktemp("out"), 1), [], "iiwa14", written.append)
    yield made, written
    made.close()
    server.stop()


def settled(page):
    """Waits until the page's worker has nothing to do; what went wrong is an error here."""
    for _ in range(2400):
        if not page.job.busy:
            assert not page.job.trouble.visible, page.job.trouble.content
            return
        time.sleep(0.05)
    raise TimeoutError


def wrote(page, written):
    """Presses the button, and waits until a recording is written."""
    before = len(written)
    page._write()
    while len(written) == before:
        settled(page)
        time.sleep(0.05)


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.filterwarnings("ignore:.*torque_sensor")
def test_the_page_and_the_command_propose_and_write_the_same(page, style, tmp_path, capsys):
    """Of every log: the same map, and with it, unchanged, the same bytes."""
    made, written = page
    german = (";", ",") if style == "german" else ()
    file = write_table(tmp_path / "log.csv", STYLES[style][0], *german)
    made.take(file)
    settled(made)
    assert made.columns() == propose(file, "iiwa14").record
    assert "--" not in made.table.content + made.doubts.content + made.guide.content  # no flag of a command
    made.name.value = tmp_path.name
    wrote(made, written)
    words = ["convert", str(file), "--robot", "iiwa14", "--guess", "--yes", "--table", "parquet"]
    assert main([*words, "--out", str(tmp_path / "rig")]) == 0
    for name in ("samples.parquet", "recording.yaml"):
        assert (written[-1] / name).read_bytes() == (tmp_path / "rig" / name).read_bytes(), name


def test_a_log_that_was_never_previewed_is_not_written(page, tmp_path):
    """What is typed after the preview can be written after its own; the command stays that of what is shown."""
    made, _ = page
    first, second = (write_table(tmp_path / name, STYLES["german"][0], ";", ",") for name in ("a.csv", "b.csv"))
    made.take(first)
    settled(made)
    assert not made.write.disabled and "a.csv" in made.commands.content
    for field, other in ((made.log, str(second)), (made.model, "ur5e")):
        before, field.value = field.value, other
        assert made.write.disabled
        made._label_write()
        assert "a.csv" in made.commands.content and "b.csv" not in made.commands.content
        field.value = before
        assert not made.write.disabled
    made.take(second)
    made.take(tmp_path / "none.csv")  # while the second is read
    while made.job.busy:
        time.sleep(0.05)
    assert made.job.trouble.visible and made.preview is None and made.write.disabled


def test_nothing_of_a_former_log_is_shown_beside_one_that_cannot_be_read(page, tmp_path):
    made, _ = page
    made.take(write_table(tmp_path / "a.csv", STYLES["own words"][0]))
    settled(made)
    assert "t_ms" in made.table.content and "400 samples" in made.doubts.content and made.plot is not None
    made.take(tmp_path / "none.csv")
    for _ in range(200):  # the job is over a moment before its error is shown
        if made.job.trouble.visible:
            break
        time.sleep(0.05)
    assert made.job.trouble.visible and made.plot is None and not made.units and not made.command_folder.visible
    assert made.table.content == html.note(NO_COLUMNS) and made.doubts.content == html.note(NO_UNITS)
    assert not made.sensor.visible and "Drop a log" in made.guide.content


@pytest.mark.parametrize(
    ("signal", "labels", "unit"),
    [
        ("q", JOINTS, "q, rad, as"),
        ("load", JOINTS, "load, as"),
        ("ee", ("x", "y", "z", "qw", "qx", "qy", "qz"), "ee, m and quaternion, as"),
        ("ft", ("fx", "fy", "fz", "tx", "ty", "tz"), "ft, N and N m, as"),
    ],
)
def test_a_plot_names_what_it_shows(page, tmp_path, signal, labels, unit):
    """A pose of seven numbers is not that of seven joints, and what has no known unit shows none."""
    made, _ = page
    pose = np.tile([0.5, 0.0, 0.3, 0.0, 1.0, 0.0, 0.0], (len(TIME), 1))
    np.savez(tmp_path / "log.npz", time=TIME, q=Q, load=TAU, ee=pose, ft=TAU[:, :6], joints=list(JOINTS))
    made.take(tmp_path / "log.npz")
    settled(made)
    made.signal.value = signal
    made._plot()
    assert tuple(line["label"] for line in made.plot.series[1:]) == labels
    assert made.plot.title == f"{unit} it would be written"


@pytest.mark.parametrize("lost", [0, 1, len(TIME) // 5])
def test_no_line_bridges_a_gap_that_can_be_seen(page, tmp_path, lost):
    made, _ = page
    rows = np.delete(np.arange(len(TIME)), slice(200, 200 + lost))
    np.savez(tmp_path / "log.npz", time=TIME[rows], q=Q[rows], joints=list(JOINTS))
    made.take(tmp_path / "log.npz")
    settled(made)
    made.signal.value = "q"
    made._plot()
    drawn = [(line["width"] > 0, line["points"]["show"]) for line in made.plot.series[1:]]
    assert drawn == 7 * [(False, True) if lost > 1 else (True, False)]


def test_the_shown_command_writes_what_the_page_wrote(page, tmp_path):
    made, written = page
    made.take(write_table(tmp_path / "same.csv", STYLES["own words"][0]))
    settled(made)
    wrote(made, written)
    before = {p.name: p.read_bytes() for p in written[-1].iterdir()}
    (line,) = re.findall("<code[^>]*>(.*?)</code>", made.commands.content)
    assert main(shlex.split(unescape(line))[1:]) == 0
    assert {p.name: p.read_bytes() for p in written[-1].iterdir()} == before


def test_every_log_of_the_command_line_is_offered(served, tmp_path):
    pytest.importorskip("viser", reason="the extra 'view' is not installed")
    first, second = (write_table(tmp_path / name, STYLES["own words"][0]) for name in ("a.csv", "b.csv"))
    page = served(first, second).logs
    assert page.log.value == str(first) and str(second) in page.found_list.options
    page.found_list.value = str(second)
    page._take_found()
    settled(page)
    assert page.asked[0] == second


def test_what_the_page_states_is_in_the_recording_and_can_be_compared(page, tmp_path, capsys):
    """A sensor and a controller that no name tells: without them nothing compares, and the page says what to state."""
    made, written = page
    columns = numbered("pos_{} [deg]", np.degrees(Q), 1) | numbered("torque_{} [Nm]", TAU, 1)
    file = write_table(
        tmp_path / "own.csv", {"t_ms": 1e3 * TIME} | columns | numbered("goal_{} [deg]", np.degrees(Q), 1)
    )
    made.take(file)
    settled(made)
    assert "Torque is" in made.guide.content
    made.sensor.value, made.mode.value = "from the motor current", "holds angles (q_cmd)"
    made.kp.value, made.kd.value = "600", "1, 2, 3, 4, 5, 6, 7"
    made._request_preview()
    settled(made)
    wrote(made, written)
    rec = load(written[-1])
    assert rec.torque_sensor == "motor" and rec.control.mode == "position" and rec.control.rate_hz == 500
    assert list(rec.control.kp) == [600] * 7 and list(rec.control.kd) == [1, 2, 3, 4, 5, 6, 7]
    assert str(made.write.label) == "Confirm and replace own"  # said before it is pressed
    made.kd.value = "1, 2"
    made._write()
    assert "one number, or 7" in made.job.trouble.content
    made.kd.value = "2"
    wrote(made, written)
    assert list(load(written[-1]).control.kd) == [2] * 7


def test_every_unit_that_may_be_proposed_can_be_chosen(page):
    made, _ = page
    for unit in FACTORS:
        made._offer(Proposed((), {"signal": unit}, {}, ()))
        assert made.units["signal"].value == unit and set(made.units["signal"].options) <= set(FACTORS)


def test_an_archive_of_a_robot_with_other_joints_is_refused_in_a_line(tmp_path):
    names = [f"A{j}" for j in range(1, 8)]
    np.savez(tmp_path / "log.npz", time=TIME, q=Q, joints=names)
    with pytest.raises(UserError, match="log.npz: joints: the robot has no such joint.*A1") as said:
        Importer(lambda name, value: None).propose(tmp_path / "log.npz", "iiwa14")
    with pytest.raises(UserError) as again:
        convert(tmp_path / "log.npz", "iiwa14", tmp_path / "rig")
    assert str(said.value) == str(again.value)
