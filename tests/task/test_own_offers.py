"""What commands offer is asked of a world's task and cell: a second task has all of its own."""

from pathlib import Path

import numpy as np
import pytest

from vispeg.api.playing import check_controls
from vispeg.api.recording.cell import motions_of
from vispeg.api.recording.commands import names
from vispeg.api.recording.record import record
from vispeg.cli.tolerance import at_tolerance
from vispeg.core.errors import UserError
from vispeg.evaluation.entrants import entrants
from vispeg.evaluation.jobs import Setting, make_jobs
from vispeg.evaluation.stress import exploit, perturb, sensitivity
from vispeg.recordings.cell import OPEN_CELL
from vispeg.task.belief import of_world
from vispeg.task.environments.vector import check_names
from vispeg.task.registry import FIRST, OURS, kind_of, scene_of, task, with_tolerance
from vispeg.task.world_file import load_world

EXAMPLE = Path(__file__).resolve().parents[2] / "docs/examples/snap_fit"
MODULE = '''"""The example with a cell of other names, a tolerance of its own, and a motion."""

from dataclasses import dataclass, replace
from functools import lru_cache

from snap_fit import SnapConfig, SnapFit
from vispeg.task.config import Tolerance
from vispeg.task.rig.motions import PATHS


@dataclass(frozen=True, kw_only=True)
class CatchConfig(SnapConfig):
    tolerance = Tolerance("play_mm", "play")
    play_mm: float = 0.5


@lru_cache
def called(scene):
    spec = scene.spec()
    for element, name in ((spec.body("peg"), "plug"), (spec.site("hole"), "socket"), (spec.joint("peg_slip"), "slip")):
        element.name = name
    parts = {"plug" if part == "peg" else part: geoms for part, geoms in scene.parts.items()}
    return replace(scene, build=spec.copy, parts=parts, held="plug", goal="socket", slip="slip")


def nod(place):
    """Nods over the socket."""
    return place.begin()


class Catch(SnapFit):
    label, Config, motions = "catch", CatchConfig, {**PATHS, "nod": nod}

    def cell(self, config, cameras=None):
        return called(super().cell(config, cameras))


class Bare(SnapFit):
    class Config(SnapConfig):
        tolerance = None
'''


@pytest.fixture
def catch(monkeypatch, tmp_path):
    (tmp_path / "catch.py").write_text(MODULE)
    for folder in (EXAMPLE, tmp_path):
        monkeypatch.syspath_prepend(str(folder))
    (tmp_path / "catch.yaml").write_text('format: vispeg-world/1\nname: catch\ntask: {name: "catch:Catch"}\n')
    return tmp_path / "catch.yaml"


def test_worlds_that_name_no_task_are_of_the_packages_own(tmp_path):
    assert FIRST in OURS and task(FIRST).Config is kind_of({})
    (tmp_path / "w.yaml").write_text("format: vispeg-world/1\n")
    assert load_world(tmp_path / "w.yaml").hash == load_world("nominal").hash


def test_a_control_bears_the_name_of_the_cells_goal_and_keeps_it_in_place(catch, tmp_path):
    world = load_world(catch)
    assert check_controls(None, world) == ("shuffled", "frozen", "socket_fixed")
    assert check_controls(None, load_world("nominal")) == ("shuffled", "frozen", "hole_fixed")
    with pytest.raises(UserError, match="unknown control.*choices: shuffled, frozen, socket_fixed"):
        check_controls(["hole_fixed"], world)
    (job,) = make_jobs(entrants(["expert"]), [Setting(str(catch), "catch", control="socket_fixed")], [1], tmp_path)
    (r,) = load_world(job.world).world.ranges
    assert r.effect == world_offset(world) and dict(r.params) == {"x": 0.0, "y": 0.0, "z": 0.0}


def world_offset(world):
    return scene_of(world.task).offset


def test_what_is_stressed_is_the_part_that_the_cell_holds(catch, tmp_path):
    fixed, *_ = [s for s, _ in exploit.settings(str(catch), "catch", range(4))]
    swept, *_ = sensitivity.settings(str(catch), "catch", sensitivity.SWEEPS["friction"])
    place = perturb.settings(str(catch), "catch", [{"name": "aside", "x": 0.01, "roll": 0.05}])[1]
    jobs = make_jobs(entrants(["expert"]), [fixed, swept, place], [1], tmp_path)
    drawn = [{(r.effect, r.where) for r in load_world(job.world).world.ranges} for job in jobs]
    assert {("contact_stiffness", "plug"), ("restitution", "plug")} <= drawn[0]
    assert drawn[1] == {("contact_friction", "plug")}
    scene = scene_of(load_world(catch).task)
    assert {effect for effect, _ in drawn[2]} == {scene.offset, scene.tilt}


def test_a_tolerance_is_the_tasks_own_setting(catch, capsys):
    world = load_world(catch)
    assert with_tolerance(world.task, 0.25) == {"play_mm": 0.25} and with_tolerance({}, 2.0) == {"clearance_mm": 2.0}
    assert with_tolerance(world.task, None) == {} == at_tolerance(entrants(["expert"]), world, None)
    with pytest.raises(UserError, match="tolerance: this task has no tolerance"):
        with_tolerance({"name": "catch:Bare"}, 1.0)
    with pytest.raises(UserError, match="did you mean 'play_mm'"):
        check_names(["gap"], (), kind_of(world.task))
    assert capsys.readouterr().err == ""


def test_a_curriculum_widens_that_setting(catch):
    pytest.importorskip("torch")
    from vispeg.learn.config import Stage, TrainConfig, read_config
    from vispeg.learn.meta import made_for, tolerance_of
    from vispeg.learn.methods.curriculum import Curriculum, stages

    config = kind_of(load_world(catch).task)()
    course = stages((2.0, 1.0), (), config)
    assert [dict(s.settings) for s in course] == [{"play_mm": 2.0}, {"play_mm": 1.0}, {}]
    assert Curriculum(course, 0.8).settings({"stack": 1}) == {"stack": 1, "play_mm": 2.0}
    with pytest.raises(UserError, match=r"widest first, above the 0\.5 mm"):
        stages((0.2,), (), config)
    with pytest.raises(UserError, match="curriculum: this task has no tolerance"):
        stages((2.0,), (), kind_of({"name": "catch:Bare"})())
    file = catch.parent / "config.yaml"
    TrainConfig("catch-state", stages=course).write(file)
    assert read_config(file).stages == course
    text = file.read_text().replace("- play_mm: 2.0", "- clearance_mm: null\n  play_mm: 2.0")  # null, as it once was
    file.write_text(text)
    assert read_config(file).stages == course and Stage() == course[-1]
    made = {"task": {"name": "catch:Catch", "play_mm": 0.25}}
    assert made_for(made) == {"play_mm": 0.25} and tolerance_of(made) == 0.25
    assert tolerance_of({"task": {"clearance_mm": 3}}) == 3.0 and tolerance_of({}) is None


def test_a_motion_of_its_own_is_offered_and_recorded(catch):
    world = of_world(str(catch))
    assert "nod" in motions_of(world) and "nod" in names("contact", str(catch))
    assert "nod" not in motions_of() and "nod" not in names("contact", OPEN_CELL)
    rec = record(world, "nod", rate_hz=200.0).recording
    assert rec.motion == "nod" and len(rec.time) == 221 and np.isfinite(rec.ft).all()
    with pytest.raises(UserError, match="not a motion of a cell"):
        record(of_world("nominal"), "nod")
