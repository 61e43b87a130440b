"""Errors of a camera's pose and intrinsics, against a camera that was placed there by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vispeg.core.effect import EffectInstance, effect, of_family
from vispeg.core.rotation import quaternion
from vispeg.render.backends.backend import Renderer
from vispeg.render.cameras.camera import Camera
from vispeg.render.cameras.standard import standard_cameras
from vispeg.render.look import Fields, dress
from vispeg.robots.scene import build
from vispeg.worlds.places import values
from vispeg.worlds.world import World

SCENE = build()
WRITERS = sorted(n for n, e in of_family("camera").items() if e.overrides("write"))
HOME = np.array([0.0, 0.6, 0.0, -1.2, 0.0, 1.3, 0.0, 0.0])  # rad; the peg's slip in m


@pytest.fixture(scope="module")
def renderer():
    with Renderer(SCENE, standard_cameras(), backend="raycast") as made:
        yield made


def by_hand(camera: Camera, name: str, p: dict[str, float]) -> Camera:
    """The camera moved as the effect's parameters say in words."""
    if name == "focal_error":
        return camera.moved(fx=camera.fx * (1 + p["fx"]), fy=camera.fy * (1 + p["fy"]))
    if name == "principal_point_error":
        return camera.moved(cx=camera.cx + p["x"], cy=camera.cy + p["y"])
    turn = Rotation.from_rotvec([p["rx"], p["ry"], p["rz"]]).as_matrix()
    shift = camera.rotation @ [p["x"], p["y"], p["z"]]
    return camera.moved(pos=tuple(camera.pos + shift), quat=tuple(quaternion(camera.rotation @ turn).tolist()))


@pytest.mark.parametrize("where", ["wrist_wide", "external"])
@pytest.mark.parametrize("name", WRITERS)
def test_the_camera_is_where_its_axes_say(name, where, renderer):
    """As from a camera put there by hand; other cameras and the nominal one stay; a new look forgets."""
    p = {k: q.start * s for (k, q), s in zip(effect(name).params.items(), (1, -0.5, 0.8, 1, -1, 2), strict=False)}
    nominal = standard_cameras()
    before = renderer.render(HOME)
    dress(renderer, SCENE, World().add(EffectInstance.of(name, where, **p)))
    seen = renderer.render(HOME)
    renderer.place([by_hand(c, name, p) if c.name == where else c for c in nominal])
    dress(renderer, SCENE, World())
    there = renderer.render(HOME)
    renderer.place(nominal)
    dress(renderer, SCENE, World())
    again = renderer.render(HOME)
    agree = np.isclose(seen[where].depth, there[where].depth, atol=1e-5)
    assert agree.mean() > 0.995 and not np.allclose(seen[where].depth, before[where].depth, atol=1e-4)
    for camera in {"external", "wrist_crop", "wrist_wide"} - {where}:
        np.testing.assert_array_equal(seen[camera].depth, before[camera].depth)
    np.testing.assert_array_equal(again[where].depth, before[where].depth)


@pytest.mark.parametrize("name", WRITERS)
def test_only_declared_fields_of_the_placed_camera_change(name, renderer):
    """At null: none, bit for bit. At its start: what it declares, in one row."""
    kind, model = effect(name), renderer.model
    fields = ("cam_pos", "cam_quat", "cam_intrinsic", "cam_fovy", "cam_sensorsize", "geom_pos", "light_pos")
    before = {f: getattr(model, f).copy() for f in fields}
    kind.write(Fields(model, SCENE), values(kind, [[EffectInstance.of(name, "all")]], SCENE))
    for f in fields:
        np.testing.assert_array_equal(getattr(model, f), before[f])
    placed = EffectInstance.of(name, "wrist_crop", **{k: q.start for k, q in kind.params.items()})
    kind.write(Fields(model, SCENE), values(kind, [[placed]], SCENE))
    changed = {f for f in fields if not np.array_equal(getattr(model, f), before[f])}
    assert changed == kind.writes
    for f in changed:
        rows = np.flatnonzero(np.any(getattr(model, f) != before[f], axis=1))
        assert [model.camera(i).name for i in rows] == ["wrist_crop"]
        getattr(model, f)[:] = before[f]


@pytest.mark.parametrize("name", WRITERS)
def test_finite_at_every_bound(name, renderer):
    for key, q in effect(name).params.items():
        for bound in (q.low, q.high):
            dress(renderer, SCENE, World().add(EffectInstance.of(name, "all", **{key: bound})))
            assert np.isfinite(renderer.render(HOME)["wrist_wide"].depth).all()
    dress(renderer, SCENE, World())
