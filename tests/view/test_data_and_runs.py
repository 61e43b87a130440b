"""Datasets frame by frame, and runs while they train, in a real browser."""

import shutil

import numpy as np
import pytest

pytest.importorskip("viser", reason="the extra 'view' is not installed")

import vispeg
from vispeg.core.assets import assets
from vispeg.core.files import set_aside
from vispeg.datasets.layout import colour_of
from vispeg.datasets.opening import open_dataset
from vispeg.view.frames import Frames
from vispeg.view.opened import opened
from vispeg.view.place import CELL
from vispeg.view.run_folder import read, runs_in
from vispeg.view.run_page import RunPage

COLUMNS = "steps,seconds,updates,success,reward,failures,critic_loss"


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """Seven frames of two episodes or more, their looks drawn."""
    out = tmp_path_factory.mktemp("data") / "frames"
    vispeg.render_dataset(out, "S", frames=7, looks=2, size=32, workers=0)
    return out


@pytest.fixture
def run(tmp_path):
    """A training run after two evaluations, whose folder has markup for a name."""
    folder = tmp_path / "run<b>x<" / "s0"
    folder.mkdir(parents=True)
    (folder / "begun.json").write_text('{"command": "vispeg train peg-state"}')
    (folder / "progress.csv").write_text(f"{COLUMNS}\n100,1,10,0,-9,approach 4,\n200,2,20,0.5,-3,slip 2,0.25\n")
    shutil.copytree(assets() / "policies" / "state-3mm", folder / "checkpoints" / "best")
    (folder / "films").mkdir()
    (folder / "films" / "7-<i>x<.mp4").write_bytes(b"film")
    return folder


def test_a_frame_is_shown_as_the_dataset_has_it(dataset):
    heard = []
    frames = Frames(lambda *what: heard.append(what))
    frames.open(str(dataset))
    frames.frame(6)
    data, last = open_dataset(dataset), heard[-1][1]
    for name in data.cameras:
        assert np.array_equal(last.pictures[f"{name}, colour"], data[6][colour_of(name)])
    holding = next(value for name, value in heard if name == "dataset")
    assert holding.frames == 7 and last.episode == len(holding.starts) - 1 and last.row == 6 - holding.starts[-1]
    worlds = [e["vispeg/world"] for e in data.episodes]
    assert dict(last.drawn).keys() == worlds[-1].keys() and holding.worlds == tuple(worlds)


def test_frames_are_browsed(dataset, page_of, served):
    assert opened([str(dataset)]).page == "Data"
    app = served(dataset)
    page = page_of(app)
    page.wait_for_selector("[data-frame='0']")
    page.get_by_role("button", name="One frame on").click()
    page.wait_for_selector("[data-frame='1']")
    assert page.locator("img").count() >= 2 * len(open_dataset(dataset).cameras)
    page.get_by_role("tab", name="All draws").click()
    page.wait_for_selector("[data-draws] svg rect")
    assert f"vispeg dataset show {dataset}" in page.content()


def test_a_run_is_read_as_it_was_written(run):
    made = read(run)
    assert made.curves["success"].tolist() == [0.0, 0.5] and np.isnan(made.curves["critic_loss"][0])
    assert made.checkpoints == ("best",) and [f.name for f in made.films] == ["7-<i>x<.mp4"]
    found = opened([str(run.parent)])
    assert found.page == "Training" and found.run == str(run.parent)


def test_a_run_that_is_being_replaced_is_not_listed(run):
    with set_aside(run, lambda: False):
        shutil.copytree(next(run.parent.glob(".s0.*.old")), run)
        assert runs_in(run.parent) == runs_in(run.parent.parent) == [run]


def test_several_runs_stand_in_the_same_curves(run, served, monkeypatch):
    """Each at its own steps: where a run has none it has no line."""
    other = shutil.copytree(run, run.parent / "s1")
    (other / "progress.csv").write_text(f"{COLUMNS}\n150,1,10,1,-2,,\n300,2,20,0.25,-1,slip 2,0.5\n")
    monkeypatch.chdir(run.parent)
    (page,) = (p for p in served(run).pages if isinstance(p, RunPage))
    page.folder.value = str(run.parent)  # the newest of it leads
    ((path, (box, _)),) = page.others.items()
    title = "success (share of episodes)"
    assert len(page.plots[title].data) == 2
    box.value = True
    steps, first, second = page.plots[title].data
    assert steps.tolist() == [100, 150, 200, 300]
    lines = {r.name: v for r, v in zip((page.latest.folder, path), (first, second), strict=True)}
    assert np.array_equal(lines["s0"], [0, 0.25, 0.5, np.nan], equal_nan=True)
    assert np.array_equal(lines["s1"], [np.nan, 1, 0.75, 0.25], equal_nan=True)
    for plot in page.plots.values():  # of itself uPlot finds no range, and draws nothing, if a line begins later
        low, high = plot.scales["y"]["range"]
        assert low <= np.nanmin(plot.data[1:]) and np.nanmax(plot.data[1:]) <= high and low < high
    box.value = False
    assert len(page.plots[title].data) == 2
    (other / "best").symlink_to("gone")  # a file that goes between a listing and a look at it
    page.follow()
    assert page.trouble.visible
    (other / "best").unlink()
    page.follow()
    assert not page.trouble.visible


@pytest.mark.slow
def test_curves_grow_while_a_run_trains_and_its_policy_plays(run, page_of, served):
    app = served(run.parent)
    page = page_of(app)
    page.wait_for_selector("text=50 %")
    assert page.locator("[data-run] h2").inner_text() == "s0"
    assert page.locator(".uplot, .u-wrap").count() >= 3
    assert page.locator("video").get_attribute("aria-label") == "film 7-<i>x<.mp4"
    with open(run / "progress.csv", "a") as file:
        file.write("300,3,30,0.75,-2,slip 1,0.2\n")
    page.wait_for_selector("text=3 evaluations")
    assert f"vispeg train --resume '{run}'" in page.locator("code").all_inner_texts()
    pytest.importorskip("torch", reason="the extra 'learn' is not installed")
    page.get_by_role("button", name="Play this checkpoint").click()
    page.wait_for_selector("[data-episode] h2")
    assert np.allclose(app.server.initial_camera.position, CELL[0]), (
        "from between the cell's walls, not from behind one"
    )
