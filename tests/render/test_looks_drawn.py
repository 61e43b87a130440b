"""Looks reach the picture: each effect at each of its places, and light from where a panorama has it."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
import pytest

from vispeg.core.effect import EffectInstance, of_family
from vispeg.effects.common.images import FOLDER
from vispeg.render.backends.backend import Renderer, Shot
from vispeg.render.cameras.camera import Camera, looking_at
from vispeg.render.cameras.standard import standard_cameras
from vispeg.render.look import dress
from vispeg.robots.scene import build
from vispeg.worlds.world import World

SCENE = build()
ABOVE = np.array([0.0, 0.7774, 0.0, -1.4955, 0.0, 0.8687, 0.0, 0.0])  # rad: the tip 40 mm above the hole's mouth
LIT = World(
    effects=(
        EffectInstance.of("light_count", "scene", extra=2),
        EffectInstance.of("distractors", "scene", count=5, seed=7),
    )
)
LOOKS = of_family("appearance")
PLACES = [(name, where) for name, kind in LOOKS.items() for where in kind.targets(SCENE)]


def towards(name: str, pos: tuple[float, ...], target: np.ndarray, size: int = 96, focal: float = 60.0) -> Camera:
    up = np.array([0.0, 0.0, 1.0]) if abs(target[2] - pos[2]) < 0.95 * np.linalg.norm(target - pos) else np.eye(3)[0]
    middle = (size - 1) / 2
    quat = looking_at(np.array(pos), target, up)
    return Camera(name, size, size, focal, focal, middle, middle, pos=pos, quat=quat)


@pytest.fixture(scope="module")
def renderer() -> Iterator[Renderer]:
    room = towards("room", (-0.9, -1.2, 1.1), np.array([0.9, 0.2, 0.1]))
    high = towards("high", (0.5, 0.0, 1.2), np.array([0.6, 0.0, 0.0]))
    cameras = (*standard_cameras(SCENE.tip, SCENE.config.fixture), room, high)
    with Renderer(SCENE.compile(), cameras, shadows=True, parts=SCENE.parts) as made:
        yield made


def drawn(renderer: Renderer, world: World) -> dict[str, Shot]:
    dress(renderer, SCENE, world)
    return renderer.render(ABOVE)


@pytest.fixture(scope="module")
def plain(renderer) -> dict[str, Shot]:
    return drawn(renderer, LIT)


def seen(a: dict[str, Shot], b: dict[str, Shot]) -> int:
    """Pixels that differ by more than rounding."""
    return sum(int((np.abs(a[k].rgb.astype(int) - b[k].rgb) > 2).any(axis=-1).sum()) for k in a)


@pytest.mark.parametrize(("name", "where"), PLACES)
def test_every_look_can_be_seen_at_every_place(renderer, plain, name, where):
    kind = LOOKS[name]
    start = {k: p.start for k, p in kind.params.items()}
    if name == "material_finish":  # a sharp highlight may fall where no camera looks
        start |= {"specular": 0.8, "shininess": -0.3}
    world = LIT.add(EffectInstance.of(name, where, **start))
    changed = drawn(renderer, world)
    assert seen(changed, plain) > 10
    if name not in ("background", "distractors"):
        for camera in plain:
            np.testing.assert_array_equal(changed[camera].depth, plain[camera].depth, "a look moves no surface")


def test_at_null_pictures_are_the_nominal_ones(renderer):
    nominal = drawn(renderer, World())
    null = [EffectInstance.of(name, where) for name, where in PLACES]
    again = drawn(renderer, World(effects=tuple(null)))
    for camera in nominal:
        np.testing.assert_array_equal(nominal[camera].rgb, again[camera].rgb)
        np.testing.assert_array_equal(nominal[camera].depth, again[camera].depth)


def test_a_sun_in_an_hdr_is_seen_where_it_stands(renderer, tmp_path, monkeypatch):
    """A camera aimed along the sun's azimuth and elevation has it in the middle; one pixel is about a degree."""
    elevation, azimuth, turn = 0.9, 2.0, -0.7
    image = np.full((128, 256, 3), 0.2, np.float32)
    i, j = int((np.pi / 2 - elevation) / np.pi * 128), int((0.5 - azimuth / (2 * np.pi)) * 256)
    image[i - 2 : i + 3, j - 3 : j + 4] = 800.0
    cv2.imwrite(str(tmp_path / "sun.hdr"), image)
    monkeypatch.setenv(FOLDER, str(tmp_path))
    dress(renderer, SCENE, World(effects=(EffectInstance.of("environment", "scene", amount=1.0, turn=turn),)))
    a = azimuth + turn
    ray = np.array([np.cos(elevation) * np.cos(a), np.cos(elevation) * np.sin(a), np.sin(elevation)])
    pos = (-0.5, -0.5, 2.0)
    with Renderer(renderer.model, [towards("up", pos, np.array(pos) + ray)]) as other:
        rgb = other.render(ABOVE)["up"].rgb.astype(int).sum(axis=-1)
    v, u = np.nonzero(rgb > 0.95 * rgb.max())
    assert rgb.max() > 1.5 * np.median(rgb)
    np.testing.assert_allclose([u.mean(), v.mean()], 47.5, atol=3.0)
