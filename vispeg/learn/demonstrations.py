"""Plays the peg task with the scripted expert and draws what its cameras see, several looks of every state.

Physics runs once an episode; then each look is drawn from the recorded states, through the world's cameras and their
sensor, exactly as the task's own observations are: the first look of an episode is the one that its seed has in play.
The expert's executed action is disturbed, so that it shows how to come back; what it meant to do is kept as the label
(Laskey et al., "DART: noise injection for robust imitation learning", CoRL 2017).
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vispeg.core.effect import effect
from vispeg.core.errors import UserError
from vispeg.core.frame import Frame
from vispeg.core.seeds import stream
from vispeg.core.world import Ranged, World
from vispeg.datasets.episode import Episode, Recorder
from vispeg.datasets.layout import Layout
from vispeg.datasets.plan import Plan, Shard, look_seed
from vispeg.learn.demonstration_plan import TASK, scene_of, seen_world, task_of
from vispeg.render.backend import Renderer, Shot
from vispeg.render.camera import Camera, quaternion
from vispeg.render.camera_files import to_record
from vispeg.render.contrast import TRIES, redraw
from vispeg.render.look import dress
from vispeg.render.pipeline import Pipeline
from vispeg.task.expert import Expert
from vispeg.task.eyes import FAR, camera_velocity
from vispeg.task.simulation import PHYSICS, PegSimulation, felt
from vispeg.task.world_file import load_world

ROWS = 4  # episodes played side by side; part of what the bytes follow from


@dataclass
class Moment:
    """What is known of one moment of an episode."""

    qpos: np.ndarray
    bodies: dict[str, np.ndarray]
    values: dict[str, np.ndarray]
    twist: np.ndarray
    flange: np.ndarray


def shard(plan: Plan, layout: Layout, wanted: Shard) -> Iterator[Episode]:
    """The episodes of one shard, the last one cut where the shard is full.

    Raises:
        UserError: the world's file has changed since the plan was made.
    """
    stage = _stage(plan, layout)
    left, number = wanted.frames, 0
    while left:
        seeds = [plan.episode_seed(wanted.number, number + i) for i in range(ROWS)]
        number += ROWS
        wanted_states = -(-left // plan.looks)
        for seed, moments, record, drawn in stage.play(seeds, wanted_states):
            shown = moments[: -(-left // plan.looks)]
            for look in range(plan.looks if left else 0):
                if left:
                    cut = record is None or min(len(shown), left) < len(moments)
                    episode = stage.draw(seed, look, shown[:left], None if cut else record, drawn)
                    left -= len(episode)
                    yield episode


class Stage:
    """A simulation, renderers and an expert that make episodes, the same ones in whatever order.

    Args:
        plan, layout: of the dataset.
    """

    def __init__(self, plan: Plan, layout: Layout):
        self.plan, self.layout = plan, layout
        file = load_world(plan.world)
        if file.hash != plan.world_hash:
            raise UserError("the world has changed since the rendering began", file=file.path)
        self.config = task_of(file, plan.cameras, plan.size)
        self.scene = scene_of(self.config)
        self.physics = replace(file.world, ranges=tuple(r for r in file.world.ranges if _kind(r) in PHYSICS))
        self.seen = seen_world(file.world, plan.cameras)
        self.sim = PegSimulation(self.physics, self.config, ROWS, "state")
        self.expert = Expert(self.config, ROWS)
        backend, shadows = str(file.renderer.get("backend", plan.backend)), bool(file.renderer.get("shadows", False))
        make = {"backend": backend, "shadows": shadows}
        self.labelled = Renderer(self.scene, layout.cameras, labels=True, **make)  # type: ignore[arg-type]
        self.plain = self.labelled if plan.labels else Renderer(self.scene, layout.cameras, **make)  # type: ignore[arg-type]

    # Physics --------------------------------------------------------------------------------------------------
    def play(
        self, seeds: Sequence[int], wanted: int | None = None
    ) -> list[tuple[int, list[Moment], dict[str, Any] | None, World]]:
        """Episodes of these seeds (ROWS of them): moments, the task's record, the drawn physics.

        With `wanted`, nothing is played on once the episodes, one after the other, have that many moments; one that was
        not played to its end has no record.
        """
        rows, sim = np.arange(ROWS), self.sim
        sim.reset(rows, seeds)
        self.expert.reset(rows)
        noise = [stream(s, "dataset-noise") for s in seeds]
        moments: list[list[Moment]] = [[] for _ in seeds]
        records: list[dict[str, Any] | None] = [None] * ROWS
        drawn = list(sim.drawn)
        while not _enough(moments, records, wanted):
            seen = sim.observation()
            meant = self.expert.act(seen)
            shaken = np.clip(meant + self.plan.noise * np.stack([g.standard_normal(3) for g in noise]), -1, 1)
            playing = [i for i in rows if records[i] is None]
            now = {i: self._moment(int(i), seen, meant[i], shaken[i]) for i in playing}
            gain, _, _, ended = sim.step(shaken)
            for i in playing:
                records[i] = ended[i]
                success = ended[i] is not None and bool(ended[i]["success"])  # type: ignore[index]
                after = {"next.reward": gain[i], "next.done": ended[i] is not None, "next.success": success}
                now[i].values.update(after)
                moments[i].append(now[i])
        return [(s, moments[i], records[i], felt(drawn[i])) for i, s in enumerate(seeds)]

    def _moment(self, row: int, seen: dict[str, np.ndarray], meant: np.ndarray, shaken: np.ndarray) -> Moment:
        sim = self.sim
        q, dq = sim.measured
        pos, _, twist = sim.control.pose(q, dq)
        tip = pos[row] - [0, 0, sim.scene.tip]
        state = np.concatenate([q[row], tip, twist[row, :3], sim.wrench[row]])
        known = sim.stack.values[:, row].copy()
        known[:, :3] += (sim.believed[row] - sim.nominal_hole) / 0.03  # as one who must look for the hole is told it
        values = {
            "observation.state": state,
            "observation.policy": np.clip(known.reshape(-1), -20, 20),
            "observation.environment_state": seen["privileged"][row],
            "action": meant,
            "executed.action": shaken,
        }
        flange = sim.cell.site_position("flange")[row].copy()
        return Moment(sim.cell.qpos[row].copy(), sim.bodies(row), values, twist[row].copy(), flange)

    # Pictures -------------------------------------------------------------------------------------------------
    def draw(
        self, seed: int, look: int, moments: Sequence[Moment], record: dict[str, Any] | None, physics: World
    ) -> Episode:
        """One look of an episode, as a file takes it; without a record it was cut before its end."""
        own = look_seed(seed, look)
        self.labelled.render(moments[0].qpos, moments[0].bodies)  # the guard judges the cell as it stands
        world, refused = redraw(self.seen, self.scene, self.labelled, own, qpos=moments[0].qpos)
        if self.plain is not self.labelled:
            dress(self.plain, self.scene, world)
        pipelines = {c.name: Pipeline([world], c.name) for c in self.layout.cameras}
        recorder = Recorder(self.layout)
        for step, moment in enumerate(moments):
            shots = self.plain.render(moment.qpos, moment.bodies)
            frame = dict(moment.values) | self._truth(shots)
            for c in self.layout.cameras:
                frame |= self._seen(c, shots[c.name], pipelines[c.name], moment, own, step)
            recorder.add(frame)
        about = {
            "task": TASK,
            "seed": seed,
            "look": look,
            "look_seed": own,
            "redraws": refused,
            "redraws_exhausted": refused >= TRIES,
            "cut": record is None,
            "success": record is not None and bool(record["success"]),
            "category": "cut" if record is None else str(record["category"]),
            "peak_force": 0.0 if record is None else float(record["peak_force"]),
            "world": {e.label: {k: v.value for k, v in e.params.items()} for e in (*physics.effects, *world.effects)},
            "cameras": [to_record(c) for c in self.plain.cameras],
        }
        return recorder.finish(about)

    def _truth(self, shots: dict[str, Shot]) -> dict[str, np.ndarray]:
        data, model = self.plain.data, self.plain.model
        found = {}
        for name, site in (("peg", "peg_tip"), ("hole", "hole")):
            i = model.site(site).id
            found[f"label.{name}"] = np.concatenate([data.site_xpos[i], quaternion(data.site_xmat[i].reshape(3, 3))])
        for name, shot in shots.items():
            found[f"label.camera.{name}"] = np.concatenate([shot.pose[:3, 3], quaternion(shot.pose[:3, :3])])
        return found

    def _seen(
        self, camera: Camera, shot: Shot, pipeline: Pipeline, moment: Moment, seed: int, step: int
    ) -> dict[str, np.ndarray]:
        frame = Frame(
            rgb=shot.rgb[None].astype(np.float32) / 255,
            depth=shot.depth[None],
            K=camera.K[None],
            truth=shot.depth[None],
            velocity=camera_velocity(camera, shot.pose[None], moment.twist[None], moment.flange[None]),
            time=np.array([step * self.config.policy_period]),
        )
        out = pipeline.run(frame, [stream(seed, "image", camera.name, step)])
        if out.rgb is None or out.depth is None:
            raise ValueError("an effect took a picture away")
        name = f"observation.images.{camera.name}"
        pictures = {
            name: np.round(255 * np.clip(out.rgb[0], 0, 1)).astype(np.uint8),
            f"{name}_depth": np.clip(np.nan_to_num(out.depth[0]), 0, FAR).astype(np.float32),
        }
        if self.plan.labels:
            pictures[f"label.parts.{camera.name}"] = shot.segmentation.astype(np.uint8)  # type: ignore[union-attr]
        return pictures

    def close(self) -> None:
        """Frees the renderers."""
        self.labelled.close()
        self.plain.close()


def _enough(moments: Sequence[Sequence[Moment]], records: Sequence[Any], wanted: int | None) -> bool:
    total = 0
    for mine, record in zip(moments, records, strict=True):
        total += len(mine)
        if wanted is not None and total >= wanted:
            return True
        if record is None:
            return False
    return True


def _kind(r: Ranged) -> str:
    return effect(r.effect).kind


_STAGES: dict[str, Stage] = {}


def _stage(plan: Plan, layout: Layout) -> Stage:
    """The stage of a plan; a worker that makes several shards of it sets it up once."""
    key = json.dumps(plan.to_json(), sort_keys=True)
    if key not in _STAGES:
        while _STAGES:
            _STAGES.popitem()[1].close()
        _STAGES[key] = Stage(plan, layout)
    return _STAGES[key]
