"""Pegs and holes from files: hexagons made here, whose clearance, mass and volume are known."""

import os

import mujoco
import numpy as np
import pytest
import trimesh

pytest.importorskip("coacd")

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.errors import UserError
from vispeg.effects.appearance.distractors import KEEP_OUT
from vispeg.render.look import Fields
from vispeg.robots import user_shapes
from vispeg.robots.scene import build
from vispeg.robots.scene_config import SceneConfig
from vispeg.task.peg.config import PegConfig
from vispeg.task.peg.task import PegInHoleVec
from vispeg.task.world_file import load_world, world_text
from vispeg.worlds.places import values

APOTHEM, LENGTH, DEPTH, HALF = 8.0, 80.0, 25.0, 30.0  # mm: peg, hole, half the block's width
CLEARANCE, CONCAVITY = 2.0, 0.02  # mm, CoACD's threshold


def hexagon(apothem: float) -> np.ndarray:
    """Corners (6, 2)."""
    turn = np.pi / 3 * np.arange(6)
    return apothem / np.cos(np.pi / 6) * np.stack([np.cos(turn), np.sin(turn)], axis=1)


def prism(corners: np.ndarray, low: float, high: float):
    """A solid over a convex outline."""
    points = np.concatenate([np.column_stack([corners, np.full(len(corners), z)]) for z in (low, high)])
    return trimesh.convex.convex_hull(points)


def holed(apothem: float):
    """A hexagonal block with a hexagonal hole right through it, top at z = 0: two tubes of walls and two rings."""
    inner, outer = hexagon(apothem), hexagon(HALF)
    rings = [(inner, 0.0), (outer, 0.0), (outer, -1.6 * DEPTH), (inner, -1.6 * DEPTH)]
    vertices = np.concatenate([np.column_stack([r, np.full(6, z)]) for r, z in rings])
    faces = []
    for k in range(4):
        for i in range(6):
            j, a, b = (i + 1) % 6, 6 * k, 6 * ((k + 1) % 4)
            faces += [(a + i, b + i, b + j), (a + i, b + j, a + j)]
    return trimesh.Trimesh(vertices, faces)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Peg and block in mm, and a cache of the tests' own."""
    folder = tmp_path_factory.mktemp("meshes")
    prism(hexagon(APOTHEM), 0.0, LENGTH).export(folder / "peg.stl")
    holed(APOTHEM + CLEARANCE / 2).export(folder / "hole.obj")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
        yield folder


def pocket(inner: float, outer: float, deep: float, high: float):
    """A square block with a square pocket that has a floor, top at z = 0; its walls come in two triangles a side."""
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], float)
    rings = [(inner, -deep), (inner, 0.0), (outer, 0.0), (outer, -high)]
    vertices = np.concatenate([np.column_stack([r * square, np.full(4, z)]) for r, z in rings])
    faces = [(0, 1, 2), (0, 2, 3), (14, 13, 12), (15, 14, 12)]
    for k in range(3):
        for i in range(4):
            j, a, b = (i + 1) % 4, 4 * k, 4 * (k + 1)
            faces += [(a + i, b + i, b + j), (a + i, b + j, a + j)]
    return trimesh.Trimesh(vertices, faces)


def given(files, **more) -> dict:
    """Keys of the task."""
    out = {"peg_mesh": str(files / "peg.stl"), "hole_mesh": str(files / "hole.obj"), "mesh_scale": 1e-3}
    return {**out, "clearance_mm": CLEARANCE, "mesh_concavity": CONCAVITY, **more}


def test_a_convex_peg_is_used_as_it_is_and_weighs_what_it_should(files):
    """Mass and inertia of a hexagonal prism in closed form; one piece, no error."""
    scene = build(SceneConfig(**given(files, peg_density=1000.0)))
    model = scene.compile()
    body = model.body("peg")
    area = 2 * np.sqrt(3) * (APOTHEM * 1e-3) ** 2
    mass = 1000 * area * LENGTH * 1e-3
    side = 2 / np.sqrt(3) * APOTHEM * 1e-3
    across = mass * (5 * side**2 / 24 + (LENGTH * 1e-3) ** 2 / 12)
    assert model.body_mass[body.id] == pytest.approx(mass, rel=1e-6)
    np.testing.assert_allclose(
        np.sort(model.body_inertia[body.id]), np.sort([5 * mass * side**2 / 12, across, across]), rtol=1e-5
    )
    assert sum(model.geom_bodyid == body.id) == 2  # one to see, one to touch
    assert scene.tip == pytest.approx(0.105 + LENGTH * 1e-3)
    nominal = scene.nominal.compile()
    assert nominal.body_mass[nominal.body("peg").id] == pytest.approx(mass, rel=1e-6)


def test_the_hole_keeps_its_volume_and_its_clearance(files):
    """The pieces fill the block and not the hole; pushed pegs would find what the check measures."""
    block = user_shapes.read(str(files / "hole.obj"), "hole_mesh", 1e-3, CONCAVITY)
    ideal = 2 * np.sqrt(3) * (HALF**2 - (APOTHEM + CLEARANCE / 2) ** 2) * 1.6 * DEPTH * 1e-9
    filled = sum(trimesh.convex.convex_hull(p).volume for p in block.pieces)
    assert block.volume == pytest.approx(ideal, rel=1e-6)
    assert filled == pytest.approx(ideal, rel=0.05)
    assert len(block.pieces) >= 3
    scene = build(SceneConfig(**given(files)))
    assert scene.config.fixture[2] == pytest.approx(1.6 * DEPTH * 1e-3)
    flange = np.array(scene.config.fixture) + [0, 0, scene.tip - 0.8 * scene.config.depth]
    left = user_shapes.gap(scene.compile(), flange)
    assert 0.75 * CLEARANCE / 2000 < left < CLEARANCE / 2000 + 1e-6
    model = scene.compile()
    model.geom_contype[:] = 0
    assert user_shapes.gap(model, flange) == 0.05, "shapes that cannot touch are as far apart as is looked"


def test_a_peg_from_a_file_in_the_built_in_hole(files):
    """A prism of 64 sides, 16 mm across its corners, goes into 18 mm; one of a hexagon, 18.5 mm across, does not."""
    turn = np.pi / 32 * np.arange(64)
    prism(APOTHEM * np.stack([np.cos(turn), np.sin(turn)], axis=1), 0.0, LENGTH).export(files / "round.stl")
    keys = {"mesh_scale": 1e-3, "mesh_concavity": CONCAVITY, "clearance_mm": CLEARANCE}
    scene = build(SceneConfig(peg_mesh=str(files / "round.stl"), **keys))
    flange = np.array(scene.config.fixture) + [0, 0, scene.tip - 0.8 * scene.config.depth]
    assert user_shapes.gap(scene.compile(), flange) == pytest.approx(CLEARANCE / 2000, abs=3e-5)
    with pytest.raises(UserError, match="does not fit"):
        build(SceneConfig(peg_mesh=str(files / "peg.stl"), **keys))


def test_pieces_are_kept_on_disk(files):
    """The second reading is the first one's, and a damaged file is made anew."""
    path = str(files / "hole.obj")
    first = user_shapes.read(path, "hole_mesh", 1e-3, CONCAVITY).pieces
    kept = list((files / "cache" / "vispeg" / "pieces").glob("*.npz"))
    assert kept
    whole = kept[0].read_bytes()
    for content in (whole, b"nothing", b"", whole[: len(whole) // 2]):  # the last as after a full disk
        user_shapes._read.cache_clear()
        kept[0].write_bytes(content)
        again = user_shapes.read(path, "hole_mesh", 1e-3, CONCAVITY).pieces
        assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))


def test_another_mesh_of_the_same_name_and_time_is_read_and_decomposed_itself(files, tmp_path):
    """`cp -p` and archives keep times. The pieces on disk, too, are those of the mesh under whose hash they are."""
    mesh = tmp_path / "hole.obj"
    for apothem, concavity in ((APOTHEM + 1, 0.05), (APOTHEM + 4, 0.06), (APOTHEM + 4, 0.05)):
        holed(apothem).export(mesh)
        os.utime(mesh, (1, 1))
        shape = user_shapes.read(str(mesh), "hole_mesh", 1e-3, concavity)
        assert shape.volume == pytest.approx(1e-9 * holed(apothem).volume, rel=1e-6)
        filled = sum(trimesh.convex.convex_hull(piece).volume for piece in shape.pieces)
        assert filled == pytest.approx(shape.volume, rel=0.02)


def test_the_room_between_outlines_is_found():
    """Squares, one in the frame of another: apart as their sides are, also turned, and negative where they overlap."""

    def ring(half: float, turn: float = 0.0, aside: float = 0.0) -> np.ndarray:
        angle = turn + np.pi / 4 + np.pi / 2 * np.arange(4)
        corners = np.sqrt(2) * half * np.stack([np.cos(angle), np.sin(angle)], axis=1) + [aside, 0.0]
        return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)

    block = np.concatenate([ring(0.009), ring(0.05)])
    assert user_shapes.play(ring(0.008), block) == pytest.approx(0.001, rel=1e-9)
    assert user_shapes.play(ring(0.008, aside=0.0004), block) == pytest.approx(0.0006, rel=1e-9)
    assert user_shapes.play(ring(0.006, np.pi / 4), block) == pytest.approx(0.009 - 0.006 * np.sqrt(2), rel=1e-9)
    assert user_shapes.play(ring(0.008, aside=0.003), block) < 0


def test_bars_crossed_like_a_plus_overlap():
    """Neither has a corner inside the other."""

    def bar(x: float, y: float) -> np.ndarray:
        corners = np.array([[x, y], [-x, y], [-x, -y], [x, -y]]) / 2
        return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)

    assert user_shapes.play(bar(0.04, 0.01), bar(0.01, 0.04)) < 0
    assert user_shapes.play(bar(0.04, 0.01), bar(0.01, 0.04) + [0.03, 0.0]) == pytest.approx(0.005)


def test_the_task_runs_with_them(files):
    """A peg put above the middle goes in when pushed down; contact is felt on the block beside the hole."""
    env = PegInHoleVec(2, world="nominal", start_radius=0.0, **given(files))
    env.reset(seed=0)
    ends = []
    for _ in range(25):
        info = env.step(np.tile([0.0, 0.0, -0.6], (2, 1)))[4]
        ends += [c for c in info.get("category", ()) if c is not None]
    assert len(ends) >= 2 and set(ends) == {"success"}
    aside = PegInHoleVec(1, world="nominal", start_radius=0.0, **given(files))
    aside.reset(seed=0)
    for k in range(20):
        aside.step(np.array([[1.0 if k < 4 else 0.0, 0.0, -0.6 if k >= 4 else 0.0]]))
    assert aside.sim.tip_in_goal()[0, 2] > -0.001 and aside.sim.tracks[0].peak > 5.0


def test_what_cannot_be_is_refused(files, tmp_path):
    """Each with the key at fault."""
    open_mesh = prism(hexagon(APOTHEM), 0.0, LENGTH)
    open_mesh.update_faces(np.arange(len(open_mesh.faces)) > 0)
    open_mesh.export(tmp_path / "open.stl")
    (tmp_path / "text.stl").write_text("this is no mesh")
    for bad, said in (
        ({"peg_mesh": str(tmp_path / "absent.stl")}, "no such mesh"),
        ({"peg_mesh": str(tmp_path / "open.stl")}, "watertight"),
        ({"peg_mesh": str(tmp_path / "text.stl")}, "peg_mesh"),
        ({"mesh_scale": 1.0}, "mesh_scale"),
        ({"clearance_mm": 3.0}, "peg and hole have a clearance of"),
        ({"depth": 0.04, "hole_origin": (0.0, 0.0, -10.0)}, "deeper"),
        ({"hole_origin": (0.0,)}, "hole_origin"),
        ({"hole_origin": (3.0, 0.0, 0.0)}, "does not fit"),
    ):
        with pytest.raises(UserError, match=said):
            build(SceneConfig(**given(files, **bad)))


def test_pieces_coarser_than_the_clearance_are_refused(files):
    """A round hole taken apart roughly cannot hold 0.2 mm."""
    ring = trimesh.creation.annulus(r_min=8.1, r_max=30.0, height=40.0, sections=48)
    ring.apply_translation([0, 0, -20.0])
    ring.export(files / "ring.stl")
    with pytest.raises(UserError, match=r"mesh_concavity: .* too coarse: .*expected 0\.01 to less than 0\.3; got 0\.3"):
        build(SceneConfig(hole_mesh=str(files / "ring.stl"), mesh_scale=1e-3, clearance_mm=0.2, mesh_concavity=0.3))


def test_meshes_are_seen(files):
    """The mesh for the eye is the file's, in the part's material; pieces are for contact alone."""
    scene = build(SceneConfig(**given(files)))
    model = scene.compile()
    for part in ("peg", "fixture"):
        assert scene.parts[part] == (part,)
        geom = model.geom(part)
        assert geom.type == mujoco.mjtGeom.mjGEOM_MESH and geom.group < 3
        assert model.material(int(geom.matid[0])).name == part


@pytest.mark.slow
def test_the_clearance_is_the_measured_one_or_one_that_agrees_with_it(files):
    """A peg of 16 mm in a pocket of 18 mm: 2 mm as drawn, less what pieces put into the pocket."""
    trimesh.creation.box([16, 16, 75]).export(files / "square.stl")
    pocket(9, 50, 25, 50).export(files / "pocket.stl")
    keys = {"peg_mesh": str(files / "square.stl"), "hole_mesh": str(files / "pocket.stl"), "mesh_scale": 1e-3}
    config = SceneConfig(**keys, mesh_concavity=0.01)
    assert 1.8 < config.clearance_mm < 2.0
    assert config.clearance_mm == PegConfig(**keys, mesh_concavity=0.01).clearance_mm
    scene = build(config)
    flange = np.array(scene.config.fixture) + [0, 0, scene.tip - 0.8 * config.depth]
    assert user_shapes.gap(scene.compile(), flange) == pytest.approx(config.clearance_mm / 2000, abs=1e-6)
    assert SceneConfig(**keys, mesh_concavity=0.01, clearance_mm=2.0).clearance_mm == 2.0  # as drawn
    for wrong in (3.0, 0.8 * config.clearance_mm):
        with pytest.raises(UserError, match=r"clearance_mm: peg and hole have a clearance of .* 2 mm by their meshes"):
            SceneConfig(**keys, mesh_concavity=0.01, clearance_mm=wrong)
    with pytest.raises(UserError, match=r"mesh_concavity: .* too coarse: .* of 2 mm"):
        SceneConfig(**keys, mesh_concavity=0.02)


def test_a_peg_from_a_file_and_a_hole_that_is_built_in(files):
    """The hole is `diameter` and `clearance_mm` wide, so a peg of another width says what `diameter` must be."""
    trimesh.creation.box([15.5, 15.5, 75]).export(files / "odd.stl")
    keys = {"peg_mesh": str(files / "odd.stl"), "mesh_scale": 1e-3, "shape": "square", "clearance_mm": 1.0}
    with pytest.raises(UserError, match=r"diameter: .*expected 0.0155"):
        SceneConfig(**keys)
    assert SceneConfig(**keys, diameter=0.0155).clearance_mm == 1.0


def test_a_short_peg_is_refused_before_anything_is_taken_apart(files, monkeypatch):
    """With the least length and the way out, though neither mesh is convex."""
    holed(APOTHEM).export(files / "short.stl")  # 40 mm long
    monkeypatch.setenv("XDG_CACHE_HOME", str(files / "other"))
    with pytest.raises(UserError, match="65 mm along z or more: .* handle") as refused:
        SceneConfig(**given(files, peg_mesh=str(files / "short.stl")))
    assert "short.stl" in str(refused.value) and not (files / "other").exists()


def test_things_of_a_world_s_own_stand_on_its_table(tmp_path, monkeypatch):
    """In their own size, on their lowest point, off the hole, seen by rays; paths and content as of peg and hole."""
    (tmp_path / "w").mkdir()
    wedge = trimesh.convex.convex_hull([[0, 0, 0], [40, 0, 0], [0, 20, 0], [0, 0, 30], [40, 20, 5]])
    wedge.export(tmp_path / "wedge.stl")
    sheet = trimesh.Trimesh([[0, 0, 7], [50, 0, 7], [50, 30, 7], [0, 30, 7]], [[0, 1, 2], [0, 2, 3]])
    sheet.export(tmp_path / "sheet.ply")  # without a thickness, and so not closed
    task = "{distractor_meshes: [../wedge.stl, ../sheet.ply], mesh_scale: 0.001}"
    text = f"format: vispeg-world/1\nname: own\nbase: nominal\ntask: {task}\n"
    (tmp_path / "w" / "a.yaml").write_text(text)
    monkeypatch.chdir(tmp_path)
    world = load_world("w/a.yaml")
    moved = tmp_path / "elsewhere.yaml"
    moved.write_text(world_text(world))
    assert load_world(moved).hash == world.hash != load_world("nominal").hash
    scene = build(PegConfig.of(world.task).scene())
    things = scene.parts["distractors"]
    assert len(things) == 2
    for seed in range(6):
        fields = Fields(scene.compile(), scene)
        placed = EffectInstance.of("distractors", "scene", count=5, seed=seed)
        effect("distractors").write(fields, values(effect("distractors"), [(placed,)], scene))
        model, data = fields.model, mujoco.MjData(fields.model)
        mujoco.mj_forward(model, data)
        for name, size in zip(things, ((40, 20, 30), (50, 30, 0)), strict=True):
            g, m = model.geom(name).id, model.geom_dataid[model.geom(name).id]
            corners = model.mesh_vert[model.mesh_vertadr[m] :][: model.mesh_vertnum[m]]
            points = corners @ data.geom_xmat[g].reshape(3, 3).T + data.geom_xpos[g]
            low, high = points[:, 2].min(), points[:, 2].max()
            assert 0 < low < 2e-4 and high - low == pytest.approx(size[2] / 1e3, abs=1e-6)
            flat = points[:, :2] - points[:, :2].mean(axis=0)
            reach = np.linalg.norm(flat[:, None] - flat[None], axis=2).max()
            assert reach == pytest.approx(np.hypot(*size[:2]) / 1e3, abs=1e-6), "a turn about z keeps its size"
            assert np.linalg.norm(points[:, :2] - data.site("hole").xpos[:2], axis=1).min() > KEEP_OUT
            assert model.geom_rgba[g, 3] == 1 and not model.geom_contype[g] and not model.geom_conaffinity[g]
            hit, above = np.zeros(1, np.int32), [*points[:, :2].mean(axis=0), 0.06]
            mujoco.mj_ray(model, data, above, [0, 0, -1.0], np.array([1, 0, 0, 0, 0, 0], np.uint8), 1, -1, hit)
            assert hit[0] == g, "rays see it where it is"
    wedge.apply_scale([1, 1, 1.1]).export(tmp_path / "wedge.stl")
    assert load_world("w/a.yaml").hash != world.hash
    wedge.apply_scale([1, 1, 3]).export(tmp_path / "wedge.stl")
    with pytest.raises(UserError, match="wedge.stl.*distractor_meshes.*60 mm"):
        load_world("w/a.yaml")


def test_a_world_sees_its_meshes_from_its_own_file_and_hashes_what_is_in_them(files, tmp_path, monkeypatch):
    """Another working folder makes no difference, another part does."""
    (tmp_path / "w").mkdir()
    for name in ("peg.stl", "hole.obj"):
        (tmp_path / name).write_bytes((files / name).read_bytes())
    task = f"{{peg_mesh: ../peg.stl, hole_mesh: ../hole.obj, mesh_scale: 0.001, mesh_concavity: {CONCAVITY}}}"
    text = f"format: vispeg-world/1\nname: hexagon\nbase: nominal\ntask: {task}\n"
    (tmp_path / "w" / "a.yaml").write_text(text)
    monkeypatch.chdir(tmp_path)
    first = load_world("w/a.yaml")
    monkeypatch.chdir(tmp_path / "w")
    assert load_world("a.yaml").hash == first.hash
    moved = tmp_path / "elsewhere.yaml"
    moved.write_text(world_text(first))
    assert load_world(moved).hash == first.hash
    prism(hexagon(APOTHEM), 0.0, LENGTH + 1).export(tmp_path / "peg.stl")
    assert load_world("a.yaml").hash != first.hash
