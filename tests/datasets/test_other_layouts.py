"""BOP's layout is checked and shown like LeRobot's; what is broken in it is told in a line each."""

import json
import shutil
import subprocess
import sys
from dataclasses import replace

import cv2
import mutations
import numpy as np
import pytest
import trimesh
import yaml
from rendered import LAYOUT, PLAN, source
from trimesh.exchange.ply import export_ply

from vispeg.core.errors import UserError
from vispeg.datasets.check import check
from vispeg.datasets.formats.models import described, ply
from vispeg.datasets.formats.registry import export
from vispeg.datasets.layout import colour_of, depth_of
from vispeg.datasets.opening import open_dataset
from vispeg.datasets.read import Dataset
from vispeg.datasets.shards.rendering import render
from vispeg.demonstrations.plan import plan_of
from vispeg.render.part_mesh import part_mesh
from vispeg.report.dataset.build import write
from vispeg.report.dataset.drawn import drawn
from vispeg.robots.scene import build

BOX = trimesh.creation.box((0.016, 0.016, 0.08))
MESH = np.asarray(BOX.vertices), np.asarray(BOX.faces)
EVERY = 16  # of the changes; the slow test tries all


@pytest.fixture(scope="module")
def source_of(tmp_path_factory):
    folder = tmp_path_factory.mktemp("layouts")
    laid = replace(LAYOUT, models={"peg": MESH, "fixture": MESH})
    render(replace(PLAN, frames=8, shard_frames=8), laid, source, folder / "d", workers=0)
    export(folder / "d", folder / "bop")
    return folder


@pytest.fixture
def folder(source_of, tmp_path):
    return shutil.copytree(source_of / "bop", tmp_path / "bop")


def test_a_sound_one_has_nothing_wrong_and_is_shown(folder, tmp_path):
    seen = []
    assert check(folder, seen.append) == [] and sum(seen) == 8
    page = write(folder, tmp_path / "page", 4).read_text()
    assert "on the base" not in page and "focal length" in page, "BOP does not say what holds a camera"
    assert "8 frames in 2 episodes" in page and (tmp_path / "page/contact-sheet.png").stat().st_size > 1000


def test_its_frames_are_those_of_the_dataset(folder, source_of):
    data, other = Dataset(source_of / "d"), open_dataset(folder)
    assert len(other) == len(data) and [e["length"] for e in other.episodes] == [e["length"] for e in data.episodes]
    for i in range(len(data)):
        want, got = data[i], other[i]
        assert np.array_equal(got["observation.images.eye"], want["observation.images.eye"])
        assert np.abs(got["observation.depth.eye"] - want["observation.depth.eye"]).max() <= 0.5001e-4
        # parts that are objects, in the objects' order
        assert np.array_equal(got["label.parts.eye"], np.array([0, 0, 1, 2])[want["label.parts.eye"]])


def test_a_constant_of_an_effect_that_some_episodes_lack_is_said_to_be_in_their_share():
    there = {"occlusion(all)": {"area": 0.1, "count": 2.0}, "near_limit(all)": {"nearest": 0.07}}
    found = drawn([there, {"near_limit(all)": {"nearest": 0.07}}, there, there])
    shares = {(row["label"], row["param"]): row["share"] for row in found["fixed"]}
    assert shares["occlusion(all)", "area"] == "in 75 % of episodes" and shares["near_limit(all)", "nearest"] == ""


def test_frames_are_counted_from_the_end_too_and_end_where_the_dataset_ends(folder):
    data = open_dataset(folder)
    for name, last in data[-1].items():
        assert np.array_equal(last, data[7][name]) and np.array_equal(data[-8][name], data[0][name])
    for beyond in (8, -9):
        with pytest.raises(IndexError):
            data[beyond]


@pytest.mark.parametrize("every", [EVERY, pytest.param(1, marks=pytest.mark.slow)], ids=["some", "all"])
def test_every_change_of_a_json_file(folder, every):
    found = {}
    scene = next(folder.glob("train/*"))
    for path in sorted([*folder.glob("*.json"), *folder.glob("models/*.json"), *scene.glob("*.json")]):
        for what in mutations.json_files(path, every, most=1):
            found[what] = mutations.tried(lambda: check(folder))
    assert not mutations.unclear(found) and len(found) > 300 / every
    for what, how in found.items():
        told = what.split(":")[0] in ("scene_camera.json", "scene_gt.json", "models_info.json")
        assert how != "fine" or not (told and what.endswith(("= nan", "= inf"))), what


def test_every_file_that_is_none(folder):
    chosen = {path.suffix + path.parent.name: path for path in sorted(folder.rglob("*")) if path.is_file()}
    names = [str(path.relative_to(folder)) for path in chosen.values()]
    found = {}
    for what in mutations.files(folder, names):
        found[what] = mutations.tried(lambda: check(folder))
    assert not mutations.unclear(found)
    assert all(how != "fine" for what, how in found.items() if "rgb" in what and "flipped" not in what)


def test_wrong_depth_is_found_and_a_dropped_frame_is_no_fault(folder):
    one, other = (folder / "train/000000/rgb/00000%d.png", folder / "train/000000/depth/00000%d.png")
    cv2.imwrite(str(other) % 1, np.zeros((8, 12), np.uint8))
    assert any("a picture of the wrong type" in line and "uint16" in line for line in check(folder))
    shutil.copy(str(other) % 0, str(other) % 1)
    shutil.copy(str(one) % 0, str(one) % 1)
    for j in range(2):
        masks = [folder / f"train/000000/mask_visib/00000{i}_00000{j}.png" for i in range(2)]
        shutil.copy(*masks)
    assert not check(folder), "a camera that drops a frame shows the one before once more"


def test_models_are_in_millimetres_with_their_extent(source_of):
    info = json.loads((source_of / "bop/models/models_info.json").read_text())
    assert set(info) == {"1", "2"}
    assert info["1"]["size_z"] == pytest.approx(80) and info["1"]["min_x"] == pytest.approx(-8)
    assert info["1"]["diameter"] == pytest.approx(np.sqrt(16**2 + 16**2 + 80**2))
    assert len(info["1"]["symmetries_discrete"]) == 3
    mesh = trimesh.load(source_of / "bop/models/obj_000001.ply")
    assert np.allclose(mesh.extents, (16, 16, 80)) and mesh.is_watertight


def test_the_cells_peg_and_fixture_have_the_models_that_are_drawn():
    peg, fixture = part_mesh(build(), "peg", "peg_tip"), part_mesh(build(), "fixture", "hole")
    about = described(peg)
    assert about["size_x"] == pytest.approx(0.016, abs=1e-5) and about["min_z"] == pytest.approx(-0.08, abs=1e-5)
    assert about["symmetries_continuous"] == [{"axis": [0, 0, 1], "offset": [0, 0, 0]}]
    assert fixture[0][:, 2].max() == pytest.approx(0, abs=1e-6)  # its top is the hole's mouth
    assert len(described(fixture)["symmetries_discrete"]) == 3


def test_planning_does_without_trimesh():
    """Its import takes 0.4 s, a twentieth of 300 frames."""
    code = "import sys, vispeg.demonstrations.plan as p; p.plan_of('S', 8); sys.exit('trimesh' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], timeout=120).returncode == 0


@pytest.mark.parametrize("scale", [1.0, 1000.0])
def test_a_models_file_is_that_of_trimesh(scale):
    scaled = trimesh.Trimesh(scale * BOX.vertices, BOX.faces, process=False)
    theirs = export_ply(scaled, encoding="binary").replace(b"comment https://github.com/mikedh/trimesh\n", b"")
    assert ply((BOX.vertices, BOX.faces), scale) == theirs


@pytest.mark.parametrize("sides", [2, 3, 5, 6])
def test_a_prism_has_the_turns_of_its_sides(sides):
    """A regular prism, or for two sides a box of unequal edges: a turn by 1/n maps it to itself."""
    angle = 2 * np.pi * np.arange(sides) / sides
    outline = (
        np.stack([np.cos(angle), np.sin(angle)], 1) if sides > 2 else np.array([(1, 2), (-1, 2), (-1, -2), (1, -2)])
    )
    vertices = np.concatenate([np.column_stack([outline, np.full(len(outline), z)]) for z in (0.0, 3.0)])
    turns = np.reshape(described((vertices, np.zeros((1, 3), int)))["symmetries_discrete"], (-1, 4, 4))
    assert len(turns) == sides - 1
    for turn in turns:
        turned = vertices @ turn[:3, :3].T
        assert np.linalg.norm(turned[:, None] - vertices, axis=-1).min(axis=1).max() < 1e-9


def test_a_camera_that_is_named_as_another_ones_depth_keeps_its_own_pictures(tmp_path):
    features = [f(name) for name in ("wrist", "wrist_depth") for f in (colour_of, lambda c: depth_of(c, ()))]
    assert [depth_of(name, features) for name in ("wrist", "wrist_depth")] == features[1::2]
    assert depth_of("wrist", ["observation.images.wrist_depth"]) == "observation.images.wrist_depth"
    cameras = {"wrist": {"width": 24, "height": 24}, "wrist_depth": {"width": 24, "height": 24}}
    (tmp_path / "w.yaml").write_text(
        yaml.safe_dump({"format": "vispeg-world/1", "base": "nominal", "cameras": cameras})
    )
    with pytest.raises(UserError, match="name of another one's depth"):
        plan_of(str(tmp_path / "w.yaml"), 4, cameras=("wrist", "wrist_depth"), size=24)


def test_a_lens_that_a_bop_dataset_states_is_read(source_of, tmp_path):
    shutil.copytree(source_of / "bop", tmp_path / "bop")
    lens = [-0.1, 0.02, 0.0, 0.001, 0.0]
    for path in (tmp_path / "bop").glob("train/*/scene_camera.json"):
        record = json.loads(path.read_text())
        path.write_text(json.dumps({key: entry | {"cam_distortion": lens} for key, entry in record.items()}))
    (camera,) = open_dataset(tmp_path / "bop").cameras.values()
    assert camera.distortion == tuple(lens)
    path.write_text(json.dumps({key: entry | {"cam_distortion": lens[:3]} for key, entry in record.items()}))
    with pytest.raises(UserError, match="cam_distortion.*five finite numbers"):
        open_dataset(tmp_path / "bop")
