"""Build evidence from sights: align on the fitted ones, and measure the held-out ones from that alignment."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vispeg.core.rules import RULES
from vispeg.identify.pictures.align import ROLLING, WINDOWS, Recall, align, rolled, unremembered
from vispeg.identify.pictures.depth_figures import FEW, NEARER
from vispeg.identify.pictures.evidence import BorderEvidence
from vispeg.identify.pictures.gather import SPACING, gather
from vispeg.identify.pictures.points import Item, Points
from vispeg.identify.pictures.posture import steadied
from vispeg.identify.pictures.robust import noise_of, trust
from vispeg.identify.pictures.scatter import Scatter
from vispeg.identify.pictures.sight import Sight
from vispeg.robots.scene import Scene
from vispeg.vision.borders import borders_of
from vispeg.vision.eye import delay_of
from vispeg.vision.predict import Predictor
from vispeg.worlds.world import World

Groups = tuple[Sequence[Sight], ...]


def seeing(scene: Scene, groups: Groups, world: World) -> tuple[tuple[list[Sight], ...], list[str]]:
    """Leave out the cameras that see nothing of the cell from their pose in a world.

    A camera sees something in a frame that shows a border of the cell, or that has depth readings on parts of the cell
    within the compared distance. If that holds for fewer than `frames_least` frames of a group, the camera is left out
    of all groups.

    Args:
        scene: the cell.
        groups: sights to fit and held-out sights; an empty group excludes no camera.
        world: gives all poses.

    Returns:
        The groups without those cameras, and a message about each camera left out.
    """
    sights = [s for group in groups for s in group]
    cameras, notes, blind = list({s.camera.name: s.camera for s in sights}.values()), [], set()
    if not cameras:
        return tuple([] for _ in groups), []
    with Predictor(scene, cameras) as predictor:
        predictor.see(world)
        for camera in cameras:
            mine = [[s for s in group if s.camera.name == camera.name] for group in groups if group]
            shown = [sum(min(_shown(predictor, s), RULES.frames_least) for s in group) for group in mine]
            if min(shown) < RULES.frames_least:
                blind.add(camera.name)
                often = f"only {min(shown)}" if min(shown) else "none"
                why = f"a border or a near surface of the cell shows in {often} of its frames"
                notes.append(f"camera '{camera.name}' is left out: {why}; is its pose as stated?")
    return tuple([s for s in group if s.camera.name not in blind] for group in groups), notes


def _shown(predictor: Predictor, sight: Sight) -> int:
    """Count the frames, up to `frames_least`, in which a sight shows something of the cell in the predictor's world."""
    frames, count = np.arange(len(sight)), 0
    for i, q in zip(frames, sight.at(frames, -delay_of(predictor.world, sight.camera.name)), strict=True):
        if count >= RULES.frames_least or not np.isfinite(q).all():
            continue
        picture, depth = predictor.draw(sight.camera.name, q), sight.depth(int(i))
        near = 0 if depth is None else int(((picture.depth > 0) & (picture.depth < NEARER[-1]) & (depth > 0)).sum())
        count += near >= FEW or len(borders_of(picture, predictor.geometry, step=SPACING)) > 0
    return count


def border_evidence(
    scene: Scene,
    fitted: Sequence[Sight],
    held_out: Sequence[Sight],
    world: World,
    robot: float | None = None,
    recall: Recall = unremembered,
) -> tuple[BorderEvidence, BorderEvidence]:
    """Return the edges of the fitted and of the held-out sights, both found from one alignment on the fitted ones.

    The read-out time of a rolling shutter is freed only if that halves the apparent errors of the robot. With an arm
    that has errors of its own, the extra parameter would only hide them. `robot` is the standard deviation of each
    joint's angle in each frame, rad; it is estimated if None. `recall` may have the alignment cached.
    """
    cameras = list({s.camera.name: s.camera for s in (*fitted, *held_out)}.values())
    with Predictor(scene, cameras) as predictor:
        stated = world.over(predictor.scene.stated)  # with the effects that the cell states
        settled, points = align(predictor, fitted, stated, recall)
        scatter = None if robot is None else Scatter(robot, 0.0)
        out = _evidence_pair(predictor, (fitted, held_out), settled, points, scatter)
        if robot is None and out[0].robot > 0:
            settled, points = rolled(predictor, fitted, settled, recall)
            other = _evidence_pair(predictor, (fitted, held_out), settled, points, None, ROLLING)
            out = other if other[0].robot < RULES.robot_half * out[0].robot else out
    return out


def _evidence_pair(
    predictor: Predictor,
    sights: tuple[Sequence[Sight], Sequence[Sight]],
    settled: World,
    points: Sequence[Points],
    scatter: Scatter | None,
    freed: tuple[str, ...] = (),
) -> tuple[BorderEvidence, BorderEvidence]:
    """Return the evidence of fitted and held-out sights, linearised at the aligned world.

    `settled` is that world, and `points` are the border points found with it.
    """
    (fitted, held_out), geometry = sights, predictor.geometry
    judged = [gather(predictor, s, settled, WINDOWS[-1]) for s in held_out]
    away, to_judge = (
        [steadied(geometry, s, settled, p) for s, p in zip(group, edges, strict=True)]
        for group, edges in ((fitted, points), (held_out, judged))
    )
    noise = {
        name: noise_of(np.concatenate([a for a, s in zip(away, fitted, strict=True) if s.camera.name == name]))
        for name in dict.fromkeys(s.camera.name for s in fitted)
    }
    evidence = BorderEvidence(geometry, _items(fitted, points, away, noise), settled, scatter, freed)
    items = _items(held_out, judged, to_judge, noise)
    return evidence, BorderEvidence(geometry, items, settled, evidence.scatter, freed)


def _items(
    sights: Sequence[Sight], points: Sequence[Points], away: Sequence[np.ndarray], noise: dict[str, float]
) -> list[Item]:
    """Return an item for each sight; `noise` (px, by camera) is estimated from `away` for cameras that it lacks."""
    out = []
    for sight, edges, off in zip(sights, points, away, strict=True):
        sigma = noise.get(sight.camera.name) or noise_of(off)
        out.append(Item(sight, edges, trust(off, sigma), np.array([sigma])))
    return out
