"""The contrast guard: sample looks until held part, fixture, mouth of the goal and background are distinguishable.

Their mean colours are compared in CIELAB (CIE 15:2004, D65) by the CIE76 distance. A look is also refused if held part,
fixture or background has few pixels, or if most of its pixels are nearly black or white, since edges are then lost.
Colours are judged as the camera delivers them, after exposure, brightness and the like: a dim look and a short exposure
may each be usable alone and give a nearly black image together. Only looks (effects of the family `appearance`) are
sampled again; physics, cameras and sensors of an episode stay as its seed gives them.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from vispeg.core.effect import effect
from vispeg.core.frame import Frame
from vispeg.core.seeds import stream
from vispeg.effects.common.light import to_linear
from vispeg.render.backends.backend import Renderer, Shot
from vispeg.render.cameras.camera import Camera
from vispeg.render.cameras.pipeline import Pipeline
from vispeg.render.look import dress
from vispeg.worlds.randomized import RandomizedWorld
from vispeg.worlds.world import World

if TYPE_CHECKING:
    from vispeg.robots.scene import Scene

BACKGROUND, RIM = "background", "rim"  # keys of the colours behind the parts, and of the surface around the mouth
BEHIND = ("table", "wall", "floor")  # parts of the background
TRIES = 20  # greatest number of looks that are sampled for an episode
TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])  # IEC 61966-2-1
DARK, BRIGHT = 6.0, 98.0  # L*: pixels darker or brighter than this count as black or white
DEEP, FLAT = 2e-3, 0.5e-3  # m: least depth of the mouth's inside; greatest distance of the rim from the mouth's plane


@dataclass(frozen=True)
class Rule:
    """Requirements that the images of a look must meet, all cameras together.

    Attributes:
        distance: least CIE76 distance between the mean colours of any two of held part, fixture and background.
        mouth: least CIE76 distance between those of the mouth's inside and its rim, if both are visible.
        pixels: least number of visible pixels of held part, of fixture and of background.
        lost: greatest share of each one's pixels that may be darker than DARK or brighter than BRIGHT, 0 to 1.
    """

    distance: float = 12.0
    mouth: float = 8.0
    pixels: int = 20
    lost: float = 0.7


def lab(rgb: np.ndarray) -> np.ndarray:
    """Return the CIELAB colours (..., 3) of encoded sRGB (..., 3) uint8."""
    xyz = to_linear(rgb.astype(np.float32) / 255).astype(float) @ TO_XYZ.T / TO_XYZ.sum(axis=1)
    f = np.where(xyz > (6 / 29) ** 3, np.cbrt(xyz), xyz / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.stack([116 * f[..., 1] - 16, 500 * (f[..., 0] - f[..., 1]), 200 * (f[..., 1] - f[..., 2])], axis=-1)


def contrast(
    shots: Mapping[str, Shot],
    cameras: Sequence[Camera],
    scene: Scene,
    rule: Rule | None = None,
    small: Collection[str] = (),
) -> float:
    """Return how well held part, fixture, its mouth and background can be distinguished, 0 to 1; 1 meets the rule.

    The score is the least of these, each divided by what the rule requires: colour distances, numbers of visible
    pixels, and shares of pixels that are neither black nor white. It is 0 if held part, fixture or background is not
    visible at all; a mouth or rim that is not visible does not count.

    Args:
        shots: shots of one moment by camera name, with labels.
        cameras: the cameras that took them.
        scene: the scene, whose parts the segmentation numbers from 1, in their order.
        rule: the requirements; default: `Rule()`.
        small: which of held part, fixture and background no look can show larger; they may have fewer pixels, or none.
    """
    rule = rule or Rule()
    colours = measure(shots, cameras, scene)
    score = 1.0
    for name in _judged(scene):
        of_part = colours[name]
        if not len(of_part):
            if name in small:
                continue
            return 0.0
        usable = float(np.mean((of_part[:, 0] > DARK) & (of_part[:, 0] < BRIGHT)))
        score = min(score, 1.0 if name in small else len(of_part) / rule.pixels, usable / (1 - rule.lost))
    pairs = ((scene.held, scene.fixture), (scene.held, BACKGROUND), (scene.fixture, BACKGROUND), (scene.goal, RIM))
    for a, b in pairs:
        if len(colours[a]) and len(colours[b]):
            apart = float(np.linalg.norm(colours[a].mean(axis=0) - colours[b].mean(axis=0)))
            score = min(score, apart / (rule.mouth if a == scene.goal else rule.distance))
    return score


def _judged(scene: Scene) -> tuple[str, str, str]:
    return scene.held, scene.fixture, BACKGROUND


def _too_small(shots: Mapping[str, Shot], cameras: Sequence[Camera], scene: Scene, rule: Rule) -> set[str]:
    """Return which of held part, fixture and background have fewer pixels in these shots than the rule requires."""
    colours = measure(shots, cameras, scene)
    return {name for name in _judged(scene) if len(colours[name]) < rule.pixels}


def measure(shots: Mapping[str, Shot], cameras: Sequence[Camera], scene: Scene) -> dict[str, np.ndarray]:
    """Return the CIELAB colours of all pixels of held part, fixture, background, the mouth's inside and its rim.

    Args:
        shots: shots of one moment by camera name, with labels.
        cameras: the cameras that took them.
        scene: the scene.

    Returns:
        `scene.held`, `scene.fixture`, BACKGROUND, `scene.goal` (the mouth's inside) or RIM -> (n, 3).

    Raises:
        ValueError: shots without labels.
    """
    number = {part: i for i, part in enumerate(scene.parts, start=1)}
    radius = scene.config.apothem + scene.config.chamfer
    groups = {scene.held: (scene.held,), scene.fixture: (scene.fixture,), BACKGROUND: BEHIND}
    out: dict[str, list[np.ndarray]] = {name: [] for name in (*groups, scene.goal, RIM)}
    for camera in cameras:
        shot = shots[camera.name]
        if shot.segmentation is None or shot.poses is None:
            raise ValueError("contrast needs a renderer with labels")
        colour, pose = lab(shot.rgb), shot.poses[scene.goal]
        for name, members in groups.items():
            out[name].append(colour[np.isin(shot.segmentation, [number[m] for m in members])])
        at = (camera.points(shot.depth) - pose[:3, 3]) @ pose[:3, :3]  # in the goal's frame
        fixture = shot.segmentation == number[scene.fixture]
        reach, height = np.hypot(at[..., 0], at[..., 1]), at[..., 2]
        out[scene.goal].append(colour[fixture & (reach < radius) & (height < -DEEP)])
        out[RIM].append(colour[fixture & (reach < 3 * radius) & (np.abs(height) < FLAT)])
    return {name: np.concatenate(parts) for name, parts in out.items()}


def delivered(shots: Mapping[str, Shot], cameras: Sequence[Camera], world: World) -> dict[str, Shot]:
    """Return the shots in the colours that the cameras of a sampled world deliver.

    Only effects that map each pixel's colour to another are applied, such as exposure and white balance. Noise, blur,
    distortion and the like are not, so that each pixel still shows the part by which it is labelled.

    Args:
        shots: shots of one moment by camera name.
        cameras: the cameras that took them.
        world: the sampled world.
    """
    photometric = world.only(lambda e: getattr(effect(e.effect), "photometric", False))
    out = dict(shots)
    for camera in cameras if photometric.effects else ():
        rgb, depth = shots[camera.name].rgb[None].astype(np.float32) / 255, shots[camera.name].depth[None]
        frame = Frame(rgb=rgb, depth=depth, K=camera.K[None], velocity=np.zeros((1, 6)), time=np.zeros(1))
        delivery = Pipeline([photometric], camera.name).run(frame, [stream(0, "photometric")])
        if delivery.rgb is not None:
            out[camera.name] = replace(
                shots[camera.name], rgb=np.round(255 * np.clip(delivery.rgb[0], 0, 1)).astype(np.uint8)
            )
    return out


def redraw(
    world: RandomizedWorld,
    scene: Scene,
    renderer: Renderer,
    seed: int,
    levels: Mapping[str, float] | float = 1.0,
    *,
    qpos: np.ndarray | None = None,
    bodies: Mapping[str, np.ndarray] | None = None,
    rule: Rule | None = None,
    tries: int = TRIES,
) -> tuple[World, int]:
    """Sample a world, and sample its look again until one meets the rule.

    The first try is `world.sample(seed, scene, levels)`. Each further look has a random stream of its own, given by the
    episode's seed and the number of the try, so the result is reproducible. If none of `tries` looks meets the rule,
    the one with the best score is kept. A part that is too small in the nominal look too, as the fixture from afar in a
    narrow view on the wrist, need not be larger. A world without ranges of looks is sampled once and not judged.

    Args:
        world: the ranges to sample.
        scene: the scene on which the effects act.
        renderer: a renderer of the scene with its parts. It is restarted, and has the look that is returned afterwards.
        seed: seed of the episode.
        levels: how far samples may be from nominal, as for `RandomizedWorld.sample`.
        qpos: (nq,) configuration in which looks are judged; default: the renderer's present one.
        bodies: the episode's poses of bodies, as for `dress`.
        rule: the requirements on a look; default: `Rule()`.
        tries: greatest number of looks to sample.

    Returns:
        The sampled world, and the number of looks that were refused; `tries` if none met the rule.
    """
    looks = tuple(r for r in world.ranges if effect(r.effect).family == "appearance")
    others = tuple(r for r in world.ranges if r not in looks)
    renderer.restart()
    best, best_score = replace(world, ranges=others).sample(seed, scene, levels), -1.0
    fixed, small, rule = best, set[str](), rule or Rule()

    def shown(drawn: World) -> dict[str, Shot]:
        """Dress the renderer, and return what its cameras deliver, with labels."""
        dress(renderer, scene, drawn, bodies)
        labels, renderer.labels = renderer.labels, True
        shots = delivered(renderer.render(qpos), renderer.cameras, drawn)
        renderer.labels = labels
        return shots

    for k in range(tries if looks else 0):
        look_seed = seed if k == 0 else int(stream(seed, "look", k).integers(2**31))
        drawn = fixed.add(*RandomizedWorld(ranges=looks).sample(look_seed, scene, levels).effects)
        shots = shown(drawn)
        if k == 0 and (small := _too_small(shots, renderer.cameras, scene, rule)):
            small &= _too_small(shown(fixed), renderer.cameras, scene, rule)
            dress(renderer, scene, drawn, bodies)  # again, as the line above has applied the nominal look
        score = contrast(shots, renderer.cameras, scene, rule, small)
        if score > best_score:
            best, best_score = drawn, score
        if score >= 1:
            return drawn, k
    dress(renderer, scene, best, bodies)
    return best, tries if looks else 0
