"""Every backend shows things where K says, at the depth that rays measure, and the same each time."""

import os

import mujoco
import numpy as np
import pytest
from spheres import BALLS, EYE, RADIUS, model, outline

from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.render.backends import classic, filament
from vispeg.render.backends.backend import Renderer
from vispeg.render.backends.raycast import cast, cast_rays
from vispeg.render.backends.warp import Warp
from vispeg.render.cameras import model_camera
from vispeg.render.cameras.camera import MAX_SIDE, PINHOLE, Camera
from vispeg.render.cameras.standard import standard_cameras
from vispeg.render.cameras.view import parent_of, view_of
from vispeg.robots.scene import build
from vispeg.vision.eye import Eye

BACKENDS = ["classic", "raycast", "filament"]
OVER = np.array([0.0, 0.6, 0.0, -1.5, 0.0, 1.04, 0.0, 0.0])  # rad, m: the peg over the hole
EDITS = [{}, {"fx": 380}, {"fy": 240}, {"cx": 140.25}, {"cy": 132.5}, {"fx": 280, "fy": 340, "cx": 170, "cy": 105.75}]

LIMB = {"classic": 0, "raycast": 0, "filament": 20}  # px of a ball's limb where labels by ray and depth may differ
FACETS = {"classic": 1e-4, "raycast": 1e-6, "filament": 2e-4}  # m, how far a drawn peg may lie inside the true one


@pytest.fixture(scope="module", params=BACKENDS)
def balls(request):
    if request.param == "filament" and (reason := filament.unusable()):
        pytest.skip(reason)
    with Renderer(model(), [EYE], request.param, labels=True) as renderer:
        yield renderer


@pytest.fixture(scope="module")
def cell():
    return build()


def edges(ids: np.ndarray, depth: np.ndarray, bend: float = 0.01) -> np.ndarray:
    """(H, W) whether a neighbour (of eight) is another geom, or 1 / depth bends by `bend` 1/m.

    1 / depth is linear in the pixel on any plane, however steep.
    """
    out, inverse = np.zeros(ids.shape, bool), 1 / np.maximum(depth, 1e-3)
    for dv, du in ((0, 1), (1, 0), (1, 1), (1, -1)):
        one, other = (np.roll(a, (dv, du), (0, 1)) for a in (ids, inverse))
        two, another = (np.roll(a, (-dv, -du), (0, 1)) for a in (ids, inverse))
        out |= (ids != one) | (ids != two) | (np.abs(other + another - 2 * inverse) > bend)
    out[[0, -1]] = out[:, [0, -1]] = True  # neighbours there are not known
    return out


@pytest.mark.parametrize("edit", EDITS, ids=str)
def test_balls_show_where_K_says(balls, edit):
    camera = EYE.moved(**edit)
    balls.place([camera])
    shot = balls.render()["eye"]
    v, u = np.mgrid[:240, :320]
    for i, expected in enumerate(outline(camera)):
        from_depth = (np.abs(shot.depth - BALLS[i, 2]) < 1.5 * RADIUS) & (
            np.hypot(u - expected[0], v - expected[1]) < 1.3 * RADIUS * max(camera.fx, camera.fy) / BALLS[i, 2]
        )
        seen = np.array([u[from_depth].mean(), v[from_depth].mean()])
        assert np.abs(seen - expected).max() < 0.1, (i, seen, expected)
        assert (from_depth != (shot.segmentation == i + 1)).sum() <= LIMB[balls.backend]


def test_colour_depth_and_labels_share_their_pixels(balls):
    balls.place([EYE])
    shot = balls.render()["eye"]
    lit = shot.rgb.sum(-1) > 0 if balls.backend != "filament" else shot.depth > 0  # its sky is not black
    assert ((shot.depth > 0) != (shot.segmentation > 0)).sum() <= 5 * LIMB[balls.backend]
    assert (lit != (shot.depth > 0)).mean() < 1e-3  # a pixel at the limb may be quite dark
    np.testing.assert_array_equal(np.linalg.norm(shot.normals, axis=-1) > 0.5, shot.segmentation > 0)


def test_depth_is_planar_in_metres(balls):
    balls.place([EYE])
    shot = balls.render()["eye"]
    for i, (x, y) in enumerate(np.rint(outline(EYE)).astype(int)):
        ray = EYE.rays()[y, x]
        b, c = ray @ BALLS[i], BALLS[i] @ BALLS[i] - RADIUS**2
        z = (b - np.sqrt(b * b - ray @ ray * c)) / (ray @ ray)  # where the ray meets the ball, along the optical axis
        assert shot.depth[y, x] == pytest.approx(z, abs=4 * FACETS[balls.backend])  # of a ball five times as large


def test_a_ray_almost_across_the_camera_meets_what_is_within_reach_in_depth():
    """A ball at a depth of 7 m, 210 m away along a ray that goes 30 m for each metre of depth."""
    ray = np.array([np.sqrt(30.0**2 - 1), 0.0, -1.0]) / 30.0
    ball = "<geom size='1' pos='{} {} {}'/>".format(*(210.0 * ray))
    seen = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{ball}</worldbody></mujoco>")
    data = mujoco.MjData(seen)
    mujoco.mj_forward(seen, data)
    depth, geom, _ = cast_rays(seen, data, np.zeros(3), ray[None], np.array([30.0]))
    assert geom.tolist() == [0] and depth == pytest.approx([209.0 / 30.0])


def test_the_same_state_gives_the_same_pixels(balls):
    balls.place([EYE])
    first = balls.render()["eye"]
    balls.place([EYE.moved(fx=200, pos=(0.31, -0.4, 1.1))])
    assert (balls.render()["eye"].depth != first.depth).any()
    balls.place([EYE])
    again = balls.render()["eye"]
    np.testing.assert_array_equal(again.depth, first.depth)
    if balls.backend == "filament":  # it dithers by the number of frames drawn
        assert np.abs(again.rgb.astype(int) - first.rgb).mean() < 1
    else:
        np.testing.assert_array_equal(again.rgb, first.rgb)


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_cell_is_as_deep_as_rays_measure(cell, backend):
    if backend == "filament" and (reason := filament.unusable()):
        pytest.skip(reason)
    cameras = standard_cameras(cell.tip, cell.config.fixture)
    with Renderer(cell, cameras, backend, labels=True) as renderer:
        for dx in (0.0, 0.06):
            shots = renderer.render(OVER + [0, dx, 0, dx, 0, 0, 0, 0], {"fixture": (0.6, dx, 0.05)})
            for camera in cameras:
                view = view_of(camera, parent_of(renderer.model, camera.parent), renderer.data)
                depth, ids, _ = cast(renderer.model, renderer.data, view)
                shot, inner = shots[camera.name], ~edges(ids, depth)
                assert inner.mean() > 0.5
                assert np.abs(shot.depth - depth)[inner].max() < FACETS[backend], camera.name
                np.testing.assert_array_equal(shot.segmentation[inner], renderer._table[ids[inner]])
                np.testing.assert_array_equal(shot.pose, view.matrix)


def test_mujocos_own_camera_sees_the_same(cell):
    """The model's row of a camera, drawn by mujoco.Renderer, is our picture: K, axes and place agree with MuJoCo's."""
    camera = standard_cameras()[0].moved(fx=50, fy=58, cx=29, cy=35.5)
    with Renderer(cell, [camera], "classic") as ours:
        depth = ours.render(OVER)["wrist_wide"].depth
        model_camera.write(ours.model, ours.model.camera("wrist_wide").id, camera)
        mujoco.mj_forward(ours.model, ours.data)
        with mujoco.Renderer(ours.model, 64, 64) as theirs:
            option = mujoco.MjvOption()
            option.geomgroup[3:] = 0
            theirs.update_scene(ours.data, "wrist_wide", option)
            theirs.enable_depth_rendering()
            expected = theirs.render()
    inner = ~edges(np.zeros((64, 64)), depth)
    assert np.abs(depth - expected)[inner].max() < 1e-4 and inner.mean() > 0.5


def test_leaving_out_what_is_not_in_sight_changes_nothing(cell):
    """The middle of a far wider picture by the same pinhole, for which much more is drawn, is the picture."""
    for camera in standard_cameras(cell.tip, cell.config.fixture):
        pad = slice(100, 164)
        wide = camera.moved(width=264, height=264, cx=camera.cx + 100, cy=camera.cy + 100)
        shots, drawn = [], []
        for eye in (camera, wide):
            with Renderer(cell, [eye], "classic") as renderer:
                shots.append(renderer.render(OVER)[camera.name])
                drawn.append(renderer._backend._scene.ngeom)
        near, far = shots
        assert drawn[0] < drawn[1]
        assert np.abs(near.rgb - far.rgb[pad, pad].astype(int)).max() <= 1
        np.testing.assert_allclose(near.depth, far.depth[pad, pad], atol=2e-5)


def test_the_sky_is_seen_and_has_no_depth(cell):
    up = standard_cameras()[2].moved(quat=(0.7071, 0.7071, 0, 0), pos=(0.6, 1.5, 1.0), fx=40, fy=40)
    for backend in ("classic", "raycast"):
        with Renderer(cell, [up], backend) as renderer:
            shot = renderer.render(OVER)["external"]
        sky = shot.depth == 0
        assert 0.2 < sky.mean() < 1.0 and shot.rgb[sky].min() > 60


def test_a_picture_has_its_sky_whatever_was_drawn_before_it(cell):
    """Geoms fill the first picture; the second looks over them, and in the third one lets the sky through."""
    down = standard_cameras()[0]
    up = standard_cameras()[2].moved(name=down.name, quat=(0.7071, 0.7071, 0, 0), pos=(0.6, 1.5, 1.0), fx=40, fy=40)
    pictures = []
    for first in (down, up):
        with Renderer(cell, [first], "classic") as renderer:
            renderer.render(OVER)
            renderer.place([up])
            pictures.append(renderer.render(OVER)[down.name])
            renderer.place([first])
            renderer.render(OVER)
            renderer.model.geom_rgba[renderer.model.geom("table").id] = (0.5, 0.3, 0.2, 0.5)
            renderer.place([down])
            pictures.append(renderer.render(OVER)[down.name])
    for one, other in ((0, 2), (1, 3)):
        np.testing.assert_array_equal(pictures[one].rgb, pictures[other].rgb)
        np.testing.assert_array_equal(pictures[one].depth, pictures[other].depth)
    assert (pictures[0].depth == 0).any() and (pictures[1].depth > 0).all()


def test_shadows_darken_where_asked_and_cost_nothing_else(cell):
    camera = standard_cameras()[2]
    pictures = {}
    for shadows in (False, True):
        with Renderer(cell, [camera], "classic", shadows=shadows) as renderer:
            plain = renderer.render(OVER)["external"].rgb
            renderer.model.light_castshadow[:2] = True
            pictures[shadows] = renderer.render(OVER)["external"].rgb.astype(int)
            np.testing.assert_array_equal(plain, pictures[False])
    darker = pictures[False] - pictures[True]
    assert (darker.sum(-1) > 60).mean() > 0.005 and darker.min() > -8  # shadows only take light away


def test_a_texture_edit_shows_after_a_refresh_and_only_it_is_sent(cell):
    for backend in ("classic", "raycast"):
        with Renderer(cell, standard_cameras()[2:], backend) as renderer:
            before = renderer.render(OVER)["external"].rgb
            assert renderer.refresh() == []
            table = renderer.model.texture("table").id
            start = int(renderer.model.tex_adr[table])
            renderer.model.tex_data[start : start + 128 * 128 * 3] = 0
            assert renderer.refresh() == [table]
            after = renderer.render(OVER)["external"].rgb
        changed = (before != after).any(-1)
        assert changed.mean() > 0.3 and after[changed].max() < 80  # highlights stay


def test_texture_scale_is_live(cell):
    with Renderer(cell, standard_cameras()[2:], "classic") as renderer:
        table = renderer.model.texture("table").id
        start = int(renderer.model.tex_adr[table])
        image = renderer.model.tex_data[start : start + 128 * 128 * 3].reshape(128, 128, 3)
        image[:64] = 0
        renderer.refresh()
        coarse = renderer.render(OVER)["external"].rgb
        renderer.model.mat_texrepeat[renderer.model.material("table").id] = 1
        assert (renderer.render(OVER)["external"].rgb != coarse).mean() > 0.05


def test_a_lens_bends_the_picture_as_its_rays_say(cell):
    camera = standard_cameras()[0].moved(distortion=(-0.15, 0.02, 0.002, -0.001, 0.0))
    with Renderer(cell, [camera], "classic", labels=True) as renderer:
        shot = renderer.render(OVER)["wrist_wide"]
        view = view_of(camera, parent_of(renderer.model, "flange"), renderer.data)
        depth, ids, _ = cast(renderer.model, renderer.data, view)  # along the lens's own rays
    inner = ~edges(ids, depth)
    assert np.median(np.abs(shot.depth - depth)[inner]) < 1e-3  # the nearest of a grid twice as fine
    assert (shot.segmentation == renderer._table[ids]).mean() > 0.97
    assert shot.rgb.shape == (64, 64, 3)


@pytest.mark.slow
@pytest.mark.parametrize(("width", "height", "f", "lens"), [
    (848, 480, 420.0, (0.01, 0.0, 0.0, 0.0, 0.0)), (640, 480, 600.0, (-0.28, 0.07, 0.0, 0.0, 0.0)),
])  # fmt: skip
def test_an_ordinary_lens_is_drawn_at_three_rays_a_pixel(width, height, f, lens):
    """As `vispeg record` draws; the undistorted image is as fine as fits, and no coarser than the camera's."""
    camera = Camera("eye", width, height, f, f, (width - 1) / 2, (height - 1) / 2, lens)
    fine = Eye(camera, camera).finer(3).camera
    warp = Warp(fine)
    assert fine.fx <= warp.pinhole.fx <= 2 * fine.fx and warp.pinhole.width <= MAX_SIDE // 2
    with pytest.raises(UserError, match="too wide to draw"):
        Warp(camera.moved(width=8 * width, distortion=PINHOLE))


@pytest.mark.parametrize("parent", ["flange", "link4", "hole", "fixture", "base"])
def test_a_camera_moves_as_its_parent_does(cell, parent):
    """Against central differences of its pose, with every joint moving."""
    camera = Camera("eye", 4, 4, 4.0, 4.0, 1.5, 1.5, parent=parent, pos=(0.05, -0.02, 0.1), quat=(0.5, -0.5, 0.5, 0.5))
    renderer = Renderer(cell, [camera], "raycast")
    model, dt = renderer.model, 1e-6
    qpos, qvel = renderer.data.qpos.copy(), stream(0, "moves").standard_normal(model.nv)
    poses = []
    for step in (-dt, dt):
        moved = qpos.copy()
        mujoco.mj_integratePos(model, moved, qvel, step)
        poses.append(renderer.render(moved)["eye"].pose)
    before, after = poses
    shot = renderer.render(qpos, qvel=qvel)["eye"]
    rot = shot.pose[:3, :3]
    turned = rot.T @ (after - before)[:3, :3] / (2 * dt)  # the matrix of the angular velocity in the camera's axes
    linear = rot.T @ (after - before)[:3, 3] / (2 * dt)
    expected = [*linear, turned[2, 1], turned[0, 2], turned[1, 0]]
    np.testing.assert_allclose(shot.velocity, expected, atol=1e-7)
    assert bool(np.any(shot.velocity)) == (parent in ("flange", "link4"))


def test_renderers_take_turns_and_memory_stays_flat(cell):
    """Two renderers in turn; then opening and drawing on and on costs no memory."""
    cameras = standard_cameras()[1:2]
    many = [Renderer(cell, cameras, "classic") for _ in range(2)]
    many[1].model.mat_rgba[:, :3] = 0
    first = [r.render(OVER)["wrist_crop"].rgb for r in many]
    for _ in range(3):
        for r, rgb in zip(many, first, strict=True):
            np.testing.assert_array_equal(r.render(OVER)["wrist_crop"].rgb, rgb)
    assert (first[0] != first[1]).any()
    many[1].close()

    def resident():
        with open("/proc/self/statm") as file:
            return int(file.read().split()[1]) * 4096 / 2**20

    for n in (200, 800):
        if n == 800:
            start = resident()
        for _ in range(n):
            many[0].render(OVER)
    assert resident() - start < 5  # MiB; a leak of one picture a frame would be 22
    for n in (2, 5):
        start = resident()
        for _ in range(n):
            Renderer(cell, cameras, "classic").close()
    assert resident() - start < 6  # one alone takes 5 MiB
    many[0].close()
    with pytest.raises(UserError, match="closed"):
        many[0].render(OVER)


def test_without_opengl_rays_take_over_and_say_so(monkeypatch, cell):
    monkeypatch.setenv("MUJOCO_GL", "disabled")
    monkeypatch.setattr("vispeg.render.backends.classic._OPEN", {})
    with pytest.warns(UserWarning, match="ray casting.*no OpenGL here"):
        renderer = Renderer(cell, standard_cameras()[2:], "auto")
    assert renderer.backend == "raycast"
    with pytest.raises(UserError, match="vispeg doctor"):
        Renderer(cell, standard_cameras()[2:], "classic")


def test_what_a_library_writes_past_python_while_it_draws_reaches_no_stream(capfd):
    """Filament tells of its inner state ("EBR Stall Warning") after some hundreds of pictures."""

    @filament._quiet()
    def draw(fails: bool) -> None:
        for number in (1, 2):
            os.write(number, b"EBR Stall Warning\n")
        if fails:
            raise UserError("no picture")

    draw(False)
    with pytest.raises(UserError, match="no picture"):
        draw(True)
    for number in (1, 2):
        os.write(number, b"ours\n")
    assert capfd.readouterr() == ("ours\n", "ours\n")


def test_mistakes_are_said(cell):
    camera = standard_cameras()[0]
    with pytest.raises(UserError, match="classic, raycast, filament"):
        Renderer(cell, [camera], "opengl")
    with pytest.raises(UserError, match="flange"):
        Renderer(cell, [camera.moved(parent="flnge")], "raycast")
    with pytest.raises(UserError, match="two cameras"):
        Renderer(cell, [camera, camera], "raycast")
    with Renderer(cell, [camera], "raycast") as renderer:
        with pytest.raises(UserError, match=r"\(8,\)"):
            renderer.render(np.zeros(7))
        with pytest.raises(UserError, match="fixture"):
            renderer.render(OVER, {"fixtur": (0, 0, 0)})


@pytest.mark.parametrize(("given", "kept"), [(None, "0"), ("2", "2")])
def test_the_software_driver_draws_in_one_thread_unless_told_otherwise(monkeypatch, given, kept):
    monkeypatch.setenv("LP_NUM_THREADS", "")
    monkeypatch.delenv("LP_NUM_THREADS")
    if given is not None:
        monkeypatch.setenv("LP_NUM_THREADS", given)
    classic._open(640, 480).free()
    assert os.environ["LP_NUM_THREADS"] == kept
