"""Looks start from the same pristine fields each time, move cameras as their effects say, and say what cannot be."""

import numpy as np
import pytest

from vispeg.core.effect import EffectInstance, of_family
from vispeg.core.errors import UserError
from vispeg.render.backends.backend import Renderer
from vispeg.render.backends.pristine import place
from vispeg.render.cameras.standard import standard_cameras
from vispeg.render.look import dress
from vispeg.robots.scene import build
from vispeg.worlds.world import World

OVER = np.array([0.0, 0.6, 0.0, -1.5, 0.0, 1.04, 0.0, 0.0])
SCENE = build()
GAUDY = World(
    effects=(
        EffectInstance.of("part_colour", "table", amount=1.0),
        EffectInstance.of("part_texture", "fixture", amount=0.8, seed=5.0),
        EffectInstance.of("distractors", "scene", count=5.0, seed=3.0),
        EffectInstance.of("light_intensity", "key", gain=1.5),
    )
)


@pytest.fixture(scope="module")
def renderer():
    with Renderer(SCENE, standard_cameras(SCENE.tip, SCENE.config.fixture), "classic", labels=True) as one:
        yield one


def visual(renderer) -> dict[str, np.ndarray]:
    names = [n for n in dir(renderer.model) if n.startswith(("geom_", "mat_", "light_", "tex_data"))]
    return {n: np.array(place(renderer.model, n)) for n in names if place(renderer.model, n).dtype != object}


def test_a_look_leaves_nothing_behind(renderer):
    dress(renderer, SCENE, World())
    fields, plain = visual(renderer), renderer.render(OVER)
    dress(renderer, SCENE, GAUDY)
    gaudy = renderer.render(OVER)
    assert (gaudy["external"].rgb != plain["external"].rgb).mean() > 0.3
    assert set(np.unique(gaudy["external"].segmentation)) != set(np.unique(plain["external"].segmentation))
    touched = dress(renderer, SCENE, World())
    for name, values in visual(renderer).items():
        np.testing.assert_array_equal(values, fields[name], err_msg=name)
    again = renderer.render(OVER)
    for name, shot in again.items():
        np.testing.assert_array_equal(shot.rgb, plain[name].rgb)
        np.testing.assert_array_equal(shot.depth, plain[name].depth)
    assert touched == [renderer.model.texture("fixture").id]  # the only pixels that had changed


def test_the_same_look_gives_the_same_pixels(renderer):
    dress(renderer, SCENE, GAUDY)
    first = renderer.render(OVER)["wrist_wide"].rgb
    dress(renderer, SCENE, World())
    dress(renderer, SCENE, GAUDY)
    np.testing.assert_array_equal(renderer.render(OVER)["wrist_wide"].rgb, first)


def test_rays_meet_what_is_drawn_after_a_look(renderer):
    """Distractors moved by hand are where rays find them: bounds for ray casting moved with them."""
    from vispeg.render.backends.raycast import cast
    from vispeg.render.cameras.view import view_of

    dress(renderer, SCENE, GAUDY)
    number = list(SCENE.parts).index("distractors") + 1
    camera = renderer.cameras[2].moved(fx=50, fy=50)
    renderer.aim([*renderer.cameras[:2], camera])
    shot = renderer.render(OVER)["external"]
    _, ids, _ = cast(renderer.model, renderer.data, view_of(camera, ("world", 0), renderer.data))
    found = renderer._table[ids] == number
    assert found.any() and ((shot.segmentation == number) == found).mean() > 0.999


@pytest.mark.parametrize("where", ["wrist_wide", "external"])
def test_camera_effects_move_what_is_drawn_and_not_what_is_believed(renderer, where):
    moved = World(
        effects=(
            EffectInstance.of("camera_offset", where, x=0.01, z=-0.02, ry=0.05),
            EffectInstance.of("focal_error", where, fx=0.02, fy=-0.01),
            EffectInstance.of("principal_point_error", where, x=2.0, y=-3.0),
        )
    )
    dress(renderer, SCENE, World())
    before = renderer.render(OVER)[where].pose
    dress(renderer, SCENE, moved)
    nominal = {c.name: c for c in renderer.nominal}
    drawn = {c.name: c for c in renderer.cameras}
    for name, camera in drawn.items():
        if name != where:
            assert camera == nominal[name]
    assert nominal == {c.name: c for c in standard_cameras(SCENE.tip, SCENE.config.fixture)}
    own, was = drawn[where], nominal[where]
    np.testing.assert_allclose((own.fx, own.fy), (1.02 * was.fx, 0.99 * was.fy), rtol=1e-6)
    np.testing.assert_allclose((own.cx, own.cy), (was.cx + 2, was.cy - 3), atol=1e-4)
    after = renderer.render(OVER)[where].pose
    step = np.linalg.inv(before) @ after  # in the camera's own axes: right, down, forward
    np.testing.assert_allclose(step[:3, 3], (0.01, 0, -0.02), atol=1e-6)
    np.testing.assert_allclose(step[:3, 2], (np.sin(0.05), 0, np.cos(0.05)), atol=1e-6)
    dress(renderer, SCENE, World())
    assert renderer.cameras == renderer.nominal


def test_every_appearance_effect_writes_only_what_it_declares(renderer):
    from vispeg.render.look import Fields
    from vispeg.worlds.places import values

    for name, effect in of_family("appearance").items():
        targets = effect.targets(SCENE)
        renderer.pristine.restore(renderer.model)
        start = {k: p.start for k, p in effect.params.items()}
        try:
            effect.write(
                Fields(renderer.model, SCENE), values(effect, [[EffectInstance.of(name, targets[0], **start)]], SCENE)
            )
        except UserError:  # it needs a folder of the user's
            continue
        kept = renderer.pristine._kept
        changed = {n for n, old in kept.items() if not np.array_equal(place(renderer.model, n), old)}
        assert changed <= set(effect.writes), name
    renderer.pristine.restore(renderer.model)


def test_what_cannot_be_worn_is_said(renderer):
    with pytest.raises(UserError, match="fixture"):
        dress(renderer, SCENE, World(effects=(EffectInstance.of("part_colour", "fixtur", amount=1.0),)))
    with Renderer(SCENE.compile(), standard_cameras()[2:], "raycast") as bare:
        with pytest.raises(UserError, match="made from the Scene"):
            dress(bare, SCENE, World(effects=(EffectInstance.of("camera_offset", "external", x=0.01),)))
