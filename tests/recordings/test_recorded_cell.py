"""What a recording says of contact: its keys, their mistakes, and how its wrench is read."""

import dataclasses
import re
import warnings
from pathlib import Path

import numpy as np
import pytest
import yaml
from made import recording
from pydantic import BaseModel
from scipy.spatial.transform import Rotation

from vispeg.core.errors import UserError
from vispeg.recordings import schema
from vispeg.recordings.cell import CellBelief, Outcome, WrenchSensor, canonical, wrench_noise
from vispeg.recordings.importers.mapping import read_map
from vispeg.recordings.importers.table import import_table
from vispeg.recordings.load import load
from vispeg.recordings.schema import Header, header_from
from vispeg.recordings.write import write

PAGE = Path(__file__).parents[2] / "docs" / "formats.md"
BELIEF = CellBelief(
    "nominal",
    {"fixture": [0.6, 0.0, 0.05], "clearance_mm": 3.0},
    {"model": "iiwa14"},
    ({"effect": "hole_tilt", "where": "fixture", "params": {"roll": 0.02}},),
)
SENSOR = WrenchSensor("base", "flange", "weight", (0.0, 0.0, 0.04), (0.6, 0.0, 0.0, 0.8))
OUTCOMES = (Outcome(True, 0, "success", 31.0, 0.024), Outcome(False, 1, "jam"))


def written(tmp_path, **changes):
    return write(recording(40, episode=np.arange(40) // 20, **changes), tmp_path / "r")


@pytest.mark.parametrize("cell", [None, CellBelief(), CellBelief("nominal"), BELIEF])
@pytest.mark.parametrize("wrench", [None, WrenchSensor(), SENSOR, WrenchSensor(tared=True)])
def test_what_is_said_of_contact_comes_back(tmp_path, cell, wrench):
    back = load(written(tmp_path, cell=cell, wrench=wrench, outcomes=OUTCOMES, noise={"ft": 0.1, "ft_torque": 0.005}))
    assert (back.cell, back.wrench, back.outcomes) == (cell, wrench, OUTCOMES)
    assert back.noise == {"ft": 0.1, "ft_torque": 0.005}


def test_a_world_file_is_found_beside_the_recording(tmp_path):
    (tmp_path / "rig.yaml").write_text("format: vispeg-world/1\n")
    folder = written(tmp_path, cell=CellBelief(str(tmp_path / "rig.yaml")))
    assert "cell: ../rig.yaml" in (folder / "recording.yaml").read_text()
    assert load(folder).cell == CellBelief(str((tmp_path / "rig.yaml").resolve()))


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ({"cell": 3}, "cell"),
        ({"cell": "rig.yaml"}, "no such file"),
        ({"cell": {"task": [1]}}, "cell.task"),
        ({"cell": {"effects": {"a": 1}}}, "cell.effects"),
        ({"wrench": {"frame": "world"}}, "wrench.frame"),
        ({"wrench": {"acts_on": "peg"}}, "wrench.acts_on"),
        ({"wrench": {"tared": "yes"}}, "wrench.tared"),
        ({"wrench": {"quat": [1, 1, 0, 0]}}, "unit length"),
        ({"wrench": {"pos_m": [0, 0]}}, "wrench.pos_m"),
        ({"outcome": {"success": "no"}}, "success"),
        ({"outcome": {"success": True, "episode": 7}}, "no such episode"),
        ({"outcome": [{"success": True}, {"success": False}]}, "given twice"),
        ({"noise": {"ft": -1}}, "noise.ft"),
        ({"control": {"mode": "position", "kp": [1, 1], "kd": [1, 1], "torque_limit_nm": [1]}}, "torque_limit_nm"),
    ],
)
def test_mistakes_end_in_one_line_with_file_and_key(tmp_path, said, message):
    file = written(tmp_path) / "recording.yaml"
    file.write_text(yaml.safe_dump(yaml.safe_load(file.read_text()) | said))
    with pytest.raises(UserError, match=re.escape(message)) as caught:
        load(file.parent)
    assert "recording.yaml" in str(caught.value) and "\n" not in str(caught.value)


def test_unknown_keys_of_a_cell_are_named(tmp_path):
    file = written(tmp_path) / "recording.yaml"
    more = {"cell": {"hole": 1}, "outcome": [{"success": True, "why": "x"}]}
    file.write_text(yaml.safe_dump(yaml.safe_load(file.read_text()) | more))
    with pytest.warns(UserWarning, match=r"cell\.hole, outcome\.why"):
        load(file.parent)


def test_a_wrench_is_the_same_in_every_frame():
    """A force at a point of the tool, read by four sensors: the reading of each, made canonical, is the first one's."""
    rng = np.random.default_rng(0)
    n = 5
    turn = Rotation.random(n, random_state=1)
    force, at = rng.normal(size=(n, 3)), rng.normal(size=(n, 3))  # flange axes
    wanted = np.concatenate([force, np.cross(at, force)], axis=1)
    pos, tilt = np.array(SENSOR.pos), Rotation.from_quat(SENSOR.quat, scalar_first=True)
    torque = np.cross(at - pos, force)
    there = np.concatenate([tilt.inv().apply(force), tilt.inv().apply(torque)], axis=1)
    base = np.concatenate([turn.apply(force), turn.apply(torque)], axis=1)
    rotation = turn.as_matrix()
    for ft, sensor in [
        (wanted, WrenchSensor()),
        (-wanted, WrenchSensor(acts_on="flange")),
        (there, dataclasses.replace(SENSOR, frame="flange", acts_on="tool")),
        (-base, dataclasses.replace(SENSOR, frame="base")),
    ]:
        assert np.allclose(canonical(ft, sensor, rotation), wanted, atol=1e-12)


def test_torque_noise_follows_that_of_force_where_it_is_not_said():
    assert wrench_noise({"q": 1.0}) is None
    assert np.allclose(wrench_noise({"ft": 0.2}), [0.2] * 3 + [0.01] * 3)
    assert np.allclose(wrench_noise({"ft": 0.2, "ft_torque": 0.3}), [0.2] * 3 + [0.3] * 3)


def _keys(section: type[BaseModel]) -> set[str]:
    out = set()
    for name, field in section.model_fields.items():
        out.add(name)
        for kind in re.findall(r"(\w+Section)", str(field.annotation)):
            out |= _keys(getattr(schema, kind))
    return out


def test_the_page_on_formats_names_every_key_and_is_itself_valid():
    text = PAGE.read_text(encoding="utf-8").split("### recording.yaml", 1)[1].split("### samples", 1)[0]
    blocks = [yaml.safe_load(b) for b in re.findall(r"```yaml\n(.*?)```", text.replace("..", "1"), re.S)]
    assert len(blocks) == 2, "the header, and a cell in full"
    words = set(re.findall(r"[a-z0-9_]+", " ".join(re.findall(r"```yaml\n(.*?)```", text, re.S))))
    assert _keys(Header) <= words, "every key of the schema stands on the page"
    head = blocks[0] | blocks[1]
    head["control"] |= {
        "kp": [1.0],
        "kd": [1.0],
        "nullspace": {"kp": 1.0, "kd": 1.0, "q": [1.0]},
        "torque_limit_nm": [1],
    }
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # a key that the schema does not have
        header_from(head, PAGE)


def test_a_map_states_cell_and_wrench_beside_the_log(tmp_path):
    """A world file is looked for beside the map that names it."""
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "rig.yaml").write_text("format: vispeg-world/1\n")
    time = np.arange(50) / 100.0
    rows = "\n".join(f"{t},{0.1 * t},{t},1,2,3,4,5,6" for t in time)
    (tmp_path / "log.csv").write_text("t,a,b,fx,fy,fz,tx,ty,tz\n" + rows + "\n")
    lines = [f"ft.{axis}: {{column: {axis}}}" for axis in ("fx", "fy", "fz", "tx", "ty", "tz")]
    lines += ["time: {column: t}", "q.a: {column: a}", "q.b: {column: b}"]
    lines += ["recording: {cell: rig.yaml, wrench: {tared: true, acts_on: flange}, noise: {ft: 0.2}}"]
    (tmp_path / "maps" / "map.yaml").write_text("\n".join(lines) + "\n")
    rec = import_table(tmp_path / "log.csv", "iiwa14", ("a", "b"), read_map(tmp_path / "maps" / "map.yaml", ("a", "b")))
    assert rec.cell == CellBelief(str((tmp_path / "maps" / "rig.yaml").resolve()))
    assert rec.wrench == WrenchSensor(acts_on="flange", tared=True) and rec.noise == {"ft": 0.2}
    assert np.array_equal(rec.ft[0], [1, 2, 3, 4, 5, 6])
