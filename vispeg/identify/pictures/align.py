"""Align predicted borders with a picture's edges from a poor start: a coarse stage, then a shrinking window.

The model is as free as these pictures allow: every camera parameter and every encoder offset is fitted at once, each
with a weak prior around its start. The fitted values are not estimates of those parameters; only the matched edges
are used.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.rules import RULES
from vispeg.identify.pictures.coarse import brought_near
from vispeg.identify.pictures.gather import gather
from vispeg.identify.pictures.points import Points, misplacement
from vispeg.identify.pictures.robust import noise_of, trust
from vispeg.identify.pictures.sight import Sight
from vispeg.identify.space import Space
from vispeg.vision.predict import Predictor
from vispeg.worlds.world import World

CAMERA = ("camera_offset", "focal_error", "principal_point_error", "lens_distortion", "camera_delay")
FREED, ROLLING = (*CAMERA, "encoder_offset"), ("rolling_shutter",)
WINDOWS = (8.0, 8.0, 5.0, 3.0)  # px within which edges are searched, stage by stage
LOOSE = 6.0  # standard deviation of the weak prior, in typical sizes
STEPS = 4  # Gauss-Newton steps at each stage
SPARSE = 12  # frames used in the coarse stage


def free_world(
    world: World, scene_joints: Sequence[str], cameras: Sequence[str], also: Sequence[str] = ()
) -> tuple[World, list[int]]:
    """Return the world with every effect that moves a picture (those it lacks at null), and the indices that are free.

    `also` are further effects of cameras.
    """
    places = [(name, camera) for camera in cameras for name in (*CAMERA, *also)]
    places += [("encoder_offset", joint) for joint in scene_joints]
    have = {(e.effect, e.where) for e in world.effects}
    world = world.add(*(EffectInstance.of(name, where) for name, where in places if (name, where) not in have))
    return world, [i for i, e in enumerate(world.effects) if (e.effect, e.where) in places]


Recall = Callable[[Any, Callable[[], Any]], Any]  # (question, function computing its answer) -> answer, maybe cached


def unremembered(question: Any, work_out: Callable[[], Any]) -> Any:
    """Compute the answer each time, without a cache."""
    return work_out()


def align(
    predictor: Predictor, sights: Sequence[Sight], world: World, recall: Recall = unremembered
) -> tuple[World, list[Points]]:
    """Return the world whose borders lie on the edges, and the points found there.

    `recall` returns a cached world if it has one.
    """

    def work_out() -> list:
        return _plain(_aligned(predictor, sights, world))

    kept = recall(["align", [[s.name, s.camera.name, len(s)] for s in sights], world.values], work_out)
    settled = replace(world, effects=tuple(EffectInstance.of(name, where, **values) for name, where, values in kept))
    return settled, [gather(predictor, s, settled, WINDOWS[-1]) for s in sights]


def rolled(
    predictor: Predictor, sights: Sequence[Sight], settled: World, recall: Recall = unremembered
) -> tuple[World, list[Points]]:
    """Align again from an aligned world, with the read-out time of each camera free as well."""

    def work_out() -> list:
        cameras = list(dict.fromkeys(s.camera.name for s in sights))
        start, free = free_world(settled, predictor.scene.joints, cameras, ROLLING)
        return _plain(_settled(predictor, sights, start, free, WINDOWS[-1:])[0].effects)

    kept = recall(["roll", [[s.name, s.camera.name, len(s)] for s in sights], settled.values], work_out)
    world = replace(settled, effects=tuple(EffectInstance.of(name, where, **values) for name, where, values in kept))
    return world, [gather(predictor, s, world, WINDOWS[-1]) for s in sights]


def _plain(effects: Sequence[EffectInstance]) -> list:
    """Return effects as plain JSON data."""
    return [[e.effect, e.where, {k: v.value for k, v in e.params.items()}] for e in effects]


def _aligned(predictor: Predictor, sights: Sequence[Sight], world: World) -> tuple[EffectInstance, ...]:
    """Return the effects of the world whose borders lie on the edges."""
    cameras = list(dict.fromkeys(s.camera.name for s in sights))
    start, free = free_world(world, predictor.scene.joints, cameras)
    few = [s.only(np.linspace(0, len(s) - 1, min(SPARSE, len(s))).round().astype(int)) for s in sights]
    best = _settled(predictor, few, start, free, WINDOWS[:2])
    if best[1] > RULES.astray:
        near = [_settled(predictor, few, w, free, WINDOWS[:2]) for w in brought_near(predictor, few, start)]
        best = min([best, *near], key=lambda t: t[1])
    return _settled(predictor, sights, best[0], free, WINDOWS[2:])[0].effects


def _settled(
    predictor: Predictor,
    sights: Sequence[Sight],
    world: World,
    free: Sequence[int],
    windows: Sequence[float],
) -> tuple[World, float]:
    """Return the world after robust steps in each window, and the share of points without an edge within 0.5 px."""
    lost = 1.0
    for window in windows:
        points = [gather(predictor, s, world, window) for s in sights]
        world = _stepped(predictor, sights, points, world, free)
        away = np.concatenate(
            [misplacement(predictor.geometry, s, world, p) for s, p in zip(sights, points, strict=True)]
        )
        lost = 1.0 - float(np.mean(np.nan_to_num(np.abs(away), nan=np.inf) < 0.5))
    return world, lost


def _stepped(
    predictor: Predictor, sights: Sequence[Sight], points: Sequence[Points], world: World, free: Sequence[int]
) -> World:
    """Return the world after robust Gauss-Newton steps of its free effects that lower the points' misplacements."""
    space = Space(world, free)
    null = np.array([space.forward(effect(world.effects[a.index].effect).params[a.name].null, a) for a in space.axes])
    low, high = space.bounds
    u = np.clip(space.start, low, high)
    for _ in range(STEPS):
        here = space.at(u)
        at = [misplacement(predictor.geometry, s, here, p) for s, p in zip(sights, points, strict=True)]
        noise = max(noise_of(np.concatenate(at)), 0.15)  # px
        # matrix and right side of the normal equations, first of the prior
        normal, along = np.eye(len(u)) / LOOSE**2, (null - u) / LOOSE**2
        steps = space.steps(u)
        for s, p, r in zip(sights, points, at, strict=True):
            weight = trust(r, noise) / noise**2
            rows = weight > 0
            trusted = p.only(rows)
            jac = np.stack(
                [
                    (misplacement(predictor.geometry, s, space.at(u + step * axis), trusted) - r[rows]) / step
                    for step, axis in zip(steps, np.eye(len(u)), strict=True)
                ],
                1,
            )
            normal += jac.T @ (weight[rows, None] * jac)
            along -= jac.T @ (weight[rows] * r[rows])
        u = np.clip(u + np.linalg.solve(normal, along), low, high)
    return space.at(u)
