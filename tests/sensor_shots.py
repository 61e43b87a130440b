"""Frames of a cell seen through a sensor; everything about them except the sensor is known."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline

from vispeg.api.recording.look import cameras_of, scene_of
from vispeg.core.effect import EffectInstance
from vispeg.identify.motions.look_motion import look_motion
from vispeg.identify.pictures.sensor import SensorEvidence, sensor_evidence
from vispeg.identify.pictures.shots import Shot, shots_of
from vispeg.identify.pictures.sight import Sight
from vispeg.recordings.cell import CellBelief
from vispeg.vision.predict import Predictor
from vispeg.worlds.world import World

CELL = World("iiwa14", "meg50+peg16", cell=CellBelief("nominal"))
WRIST, FRAMES = "wrist_wide", 6
LIT = World(effects=(EffectInstance.of("light_intensity", "all"),))  # the look is the predictor's own


@lru_cache
def shots() -> tuple[Sight, list[Shot]]:
    """Predicted frames along the look-about motion, with nothing measured."""
    scene = scene_of(CELL)
    (camera,) = cameras_of([WRIST], scene, (160, 120))
    motion = look_motion("look", scene, 100.0, 16.0)
    curve = CubicSpline(motion.time, motion.q_cmd)
    sight = Sight("x", camera, np.linspace(1, 15, FRAMES), lambda t, i: curve(t), lambda i: None, lambda i: None)
    with Predictor(scene, [camera], finer=3) as predictor:
        return sight, shots_of(predictor, sight, CELL, np.zeros((FRAMES, len(scene.joints))))


def measured(kind: str, *effects: EffectInstance, model: World = LIT) -> SensorEvidence:
    """Evidence of frames that passed through a sensor with these effects."""
    sight, some = shots()
    world = CELL.add(*effects)
    out = []
    for shot in some:
        rgb, depth = shot.sensed(world, lambda k: True)
        out.append(replace(shot, rgb=rgb, depth=depth))
    evidence = sensor_evidence(scene_of(CELL), [(sight, out)], kind, model)
    assert evidence is not None
    return evidence
