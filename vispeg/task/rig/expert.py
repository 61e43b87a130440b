"""Record an episode of the task under its scripted expert and its own controller."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Literal

import numpy as np

from vispeg.core.errors import UserError
from vispeg.recordings.cell import Outcome
from vispeg.recordings.recording import Recording
from vispeg.recordings.validate import check_length
from vispeg.task.belief import model_cell
from vispeg.task.environments.simulation import TaskSimulation
from vispeg.task.registry import task_of
from vispeg.task.rig.posture import posture
from vispeg.task.rig.record import controller, recording, refuse_diverged, with_noise
from vispeg.task.rig.run import STEP, Reader
from vispeg.worlds.world import World

EXPERT = "expert"
AIR = 1.0  # s in free air before the expert begins


def record_expert(
    world: World,
    seed: int,
    noise: Mapping[str, float],
    rng: np.random.Generator,
    *,
    rate_hz: float = 500.0,
    torque_sensor: Literal["joint", "none"] = "joint",
    repeat: int = 1,
    name: str = "simulated",
    force_limit: float | None = None,
    h_max: float = STEP,
) -> Recording:
    """Record one episode: a second in free air, then the scripted expert until success, failure or its time limit.

    Args:
        world: the simulated robot: a model with a cell and effects.
        seed: of the episode; it decides where the tip begins.
        noise, rng, rate_hz, torque_sensor, repeat, name, h_max: as for `record_cell`.
        force_limit: largest force that the controller commands, N; None for the task's.

    Raises:
        UserError: the simulation diverges, the world has no cell, or the policy period is not a whole number of control
            periods (1 / rate_hz).
    """
    belief = model_cell(world)
    if force_limit is not None:
        belief = replace(belief, config=replace(belief.config, force_limit=force_limit))
    check_length(belief.config.steps * belief.config.policy_period, rate_hz)
    nsub = max(1, math.ceil(1.0 / (rate_hz * h_max) - 1e-9))
    wait = math.ceil(AIR / belief.config.policy_period)
    changes = {"control_period": 1.0 / rate_hz, "substeps": nsub, "avoid_limits": 0.0}
    try:
        config = replace(belief.config, **changes, steps=belief.config.steps + wait)
    except UserError as error:
        raise UserError(str(error), key="--rate", got=rate_hz) from error
    sim = TaskSimulation(belief.world.add(*world.effects), config, 1)
    sim.cell.use_recording_settings()
    sim.reset(np.arange(1), [seed])
    sim.control.home = posture(belief.scene)  # the recording states this posture for the null space
    ticks = config.steps * config.ticks
    reader, ee_cmd = Reader(ticks, 1, len(belief.scene.joints)), list[np.ndarray]()

    def heard(q: np.ndarray, dq: np.ndarray, felt: np.ndarray) -> None:
        reader.tick(len(ee_cmd), sim.cell, q, dq, felt)
        ee_cmd.append(np.concatenate([sim.seen.goal[0], sim.seen.rot[0]]))

    sim.heard = heard
    for _ in range(wait):
        sim.step(np.zeros((1, len(config.dof))))
    expert, ended = task_of(config).expert(config, 1), None
    expert.reset(np.arange(1))
    while ended is None:
        *_, (ended,) = sim.step(expert.act(sim.observation()))
    n = len(ee_cmd)
    ran = reader.ran(sim.diverged, n)
    refuse_diverged(ran)
    control = controller(belief.scene, config, rate_hz)
    depth = float(ended["depth"])
    outcome = Outcome(bool(ended["success"]), 0, str(ended["category"]), float(ended["peak_force"]), depth)
    time = np.arange(n) / rate_hz
    rec = recording(belief, world, control, ran, np.array(ee_cmd), time, name, EXPERT, (outcome,))
    return with_noise([rec] * repeat, noise, rng, torque_sensor)
