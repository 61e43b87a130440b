"""The way through the page: each state says what to do next, and has the control to do it."""

import re
import time

import pytest
from bare_arm import bare

from vispeg.core.seeds import stream
from vispeg.view.drop import kept
from vispeg.view.html import distinct

pytest.importorskip("viser", reason="the extra 'view' is not installed")


def until(true, seconds=240):
    """Waits for something that the page's threads or workers do."""
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end
        time.sleep(0.05)


def says(page):
    """What a page says is to be done next, and the step of the way that it stands at."""
    text = page.guide.content
    at = re.search(r'aria-current="step">(\d)', text)
    said = re.sub("<[^>]+>", "", text.partition('role="status"')[2].partition(">")[2]).strip()
    assert "--" not in said  # no flag of a command
    return said, int(at[1]) if at else 0


def test_from_nothing_to_what_is_missing(rigs, served, monkeypatch):
    """What lies under the folder is offered; a robot stands there from the first moment; recordings come and go."""
    monkeypatch.chdir(rigs)
    app = served()
    study = app.study
    assert says(study)[1] == 1 and "Drop your model" in says(study)[0]
    assert study.example.visible and study.compare.disabled and not study.missing.visible and not study.left.visible
    until(lambda: study.traces.arm is not None)
    study.model.value = "arm.xml"
    until(lambda: study.traces.arm.model.njnt == 2)
    assert {"rig-a", "rig-b", "rig-c"} <= set(study.here.options)
    for name in ("rig-a", "rig-b", "rig-c"):
        study.here.value = name
    assert [d.value for d in study.roles.values()] == ["fit", "fit", "judge on"]
    study.roles[rigs / "rig-c"].value = "remove"
    assert list(study.roles) == [rigs / "rig-a", rigs / "rig-b"] and "rig-c" in study.here.options
    assert [d.value for d in study.roles.values()] == ["fit", "judge on"]  # another judges
    assert "Compare" in says(study)[0] and not study.compare.disabled
    study.open()
    until(lambda: study.candidates and not study.job.busy)
    assert says(study)[1] == 4 and "candidate" in says(study)[0]
    assert study.missing.visible and study.left.visible and study.results.visible
    app.show("Data")
    assert not study.left.visible and study.traces.arm.root.visible and "dataset" in says(app.pages[4])[0]
    app.show("Diagnose")
    study.model.value = "iiwa14"  # another model: what was compared is put aside
    assert says(study)[1] == 1 and study.standing is None and not study.missing.visible


@pytest.mark.slow
def test_commands_name_what_was_compared_and_another_model_ends_the_work(rigs, served):
    study = served(rigs / "arm.xml", rigs / "rig-a", rigs / "rig-b").study
    until(lambda: study.candidates and not study.job.busy)
    said = study.commands.content
    assert "rig-b" in said
    study.add(rigs / "rig-c")  # as an import does: it judges the next comparison, not the one that is shown
    study.job.ask("show")
    until(lambda: not study.job.busy)
    assert study.commands.content == said
    study.open()
    assert study.job.busy and study.job.button.visible and study.standing is None
    study.model.value = "iiwa14"
    assert not study.job.busy and not study.job.button.visible and not study.job.bar.visible
    study.job.stop()  # a click that came too late
    assert not study.job.busy and study.standing is None


def test_what_is_dropped_goes_where_it_belongs(served, tmp_path, monkeypatch):
    """A URDF without meshes is the model and stands there, a log opens Import for it, anything else is refused."""
    monkeypatch.chdir(tmp_path)
    app = served()
    urdf = bare(stream(1, "dropped")).encode()
    path = kept(tmp_path / "kept", "../arm.urdf", urdf)
    assert path == tmp_path / "kept" / "arm.urdf"
    assert kept(tmp_path / "kept", "arm.urdf", urdf) == path  # the same once more is the same
    other = kept(tmp_path / "kept", "arm.urdf", urdf + b" ")
    assert other.name == "arm-2.urdf" and path.read_bytes() == urdf
    app.study.take(path)
    assert app.study.chosen_model == str(path)
    until(lambda: app.study.traces.arm is not None and app.study.traces.arm.model.njnt == 6)
    assert len(app.study.traces.arm.frames) == 6  # capsules for all its links
    app.study.take(kept(tmp_path / "kept", "log.csv", b"t,pos_1\n0,0\n"))
    assert app.logs.root.visible and str(app.logs.log.value).endswith("log.csv")
    assert str(app.logs.model.value) == str(path)
    app.study.take(kept(tmp_path / "kept", "notes.xml", b"<html/>"))
    assert "neither a model nor a log" in app.study.job.trouble.content


@pytest.mark.parametrize(
    ("names", "short"),
    [
        ([f"panda_joint{i}" for i in range(1, 8)], [f"joint{i}" for i in range(1, 8)]),
        (["shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint"], ["shoulder_pan", "shoulder_lift", "elbow"]),
        (["left/arm/j1", "left/arm/j2"], ["j1", "j2"]),
        (["joint1", "joint2"], ["joint1", "joint2"]),
        (["a_b", "a_b_c"], ["b", "b_c"]),
        (["force x", "force y", "torque x"], ["force x", "force y", "torque x"]),
        (["one"], ["one"]),
        (["same", "same"], ["same", "same"]),
    ],
)
def test_names_side_by_side_lose_what_they_share(names, short):
    assert distinct(names) == short and len(set(distinct(names))) == len(set(names))
