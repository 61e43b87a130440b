"""Play a task with its scripted expert and render what its cameras see, in several looks of every state.

Physics runs once per episode. Each look is then rendered from the recorded states, through the world's cameras and
their sensor effects, as the task's own observations are; the first look is the one that the episode's seed gives in
play. Noise on the expert's executed actions makes it show how to recover; the label is the action without noise
(Laskey et al., "DART: noise injection for robust imitation learning", CoRL 2017).
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import count
from typing import Any, cast

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.rotation import quaternion
from vispeg.core.seeds import stream
from vispeg.datasets.episode import Episode, Recorder
from vispeg.datasets.layout import Layout, colour_of, depth_of, truth_of
from vispeg.datasets.shards.plan import Plan, Shard, look_seed
from vispeg.datasets.shards.shard import drawn
from vispeg.demonstrations.plan import images_of, scene_of, task_of
from vispeg.demonstrations.sensing import ROWS as SENSOR_ROWS
from vispeg.demonstrations.sensing import Clip, sense
from vispeg.effects.common.images import FOLDER
from vispeg.interface.terms import LIMIT, PRIVILEGED
from vispeg.render.backends.backend import BackendName, Renderer
from vispeg.render.block_matching import Matcher
from vispeg.render.cameras.camera_files import to_record
from vispeg.render.contrast import TRIES, redraw
from vispeg.render.image_kinds import FAR
from vispeg.render.snapshot import Snapshot
from vispeg.task.environments.simulation import TaskSimulation
from vispeg.task.registry import task_of as contract_of
from vispeg.task.result import EpisodeResult
from vispeg.task.world_file import load_world
from vispeg.worlds.split import moving, optical
from vispeg.worlds.world import World

ROWS = 4  # episodes played side by side; a dataset's bytes depend on it
TAKES = 2 * SENSOR_ROWS  # looks that are rendered before sensor effects are applied to all of them


@dataclass
class Moment:
    """One moment of an episode: the state of the cell, and the values of a frame without its images."""

    cell: Snapshot
    values: dict[str, np.ndarray]


@dataclass
class Played:
    """An episode: its seed, the physics drawn, its action noise, its moments, and its record (None until it ends)."""

    seed: int
    physics: World
    noise: np.random.Generator
    moments: list[Moment] = field(default_factory=list)
    record: EpisodeResult | None = None


@dataclass(frozen=True)
class Take:
    """One rendered look of an episode, before sensor effects.

    Attributes:
        frames: values of every frame, without images and their labels.
        labels: poses of every moment, by camera; a late image gets those of the moment that it shows.
        clips: images by camera.
        about: metadata of the episode.
    """

    frames: list[dict[str, np.ndarray]]
    labels: dict[str, list[dict[str, np.ndarray]]]
    clips: dict[str, Clip]
    about: dict[str, object]


def shard(plan: Plan, layout: Layout, wanted: Shard) -> Iterator[Episode]:
    """Yield the episodes of one shard; the last one is cut where the shard is full.

    Raises:
        UserError: the world's file has changed since the plan was made.
    """
    stage = _stage(plan, layout)
    remaining, takes = wanted.frames, list[Take]()
    seeds = (plan.episode_seed(wanted.number, i) for i in count())
    for episode in stage.play(seeds, math.ceil(remaining / plan.looks)):
        most = math.ceil(remaining / plan.looks)
        for look in range(plan.looks):
            if remaining:
                takes.append(stage.take(episode, look, min(most, remaining)))
                remaining -= len(takes[-1].frames)
            if len(takes) == TAKES:
                yield from stage.develop(takes)
                takes.clear()
    yield from stage.develop(takes)


class Stage:
    """Make episodes with a simulation, an expert and a renderer; each episode depends only on its seed.

    Args:
        plan: plan of the dataset.
        layout: layout of its frames.

    Raises:
        UserError: the world's file, or the images from which its looks draw, have changed since the plan was made.
    """

    def __init__(self, plan: Plan, layout: Layout):
        self.plan, self.layout = plan, layout
        file = load_world(plan.world)
        if file.hash != plan.world_hash:
            raise UserError("the world has changed since the rendering began", file=file.path)
        if images_of(file, plan.cameras) != plan.images:
            expected = f"the images with which it began: {FOLDER} as then, on every machine"
            raise UserError("other images for looks than the rendering began with", file=file.path, expected=expected)
        self.config = task_of(file, plan.cameras, plan.size)
        self.scene = scene_of(self.config)
        self.seen = optical(file.world, plan.cameras)
        self.sim = TaskSimulation(file.world, self.config, ROWS, "state")
        self.task = contract_of(self.config)
        self.expert = self.task.expert(self.config, ROWS)
        self.renderer = Renderer(
            self.scene,
            layout.cameras,
            cast("BackendName", plan.backend),  # a renderer refuses other words
            labels=plan.labels,
            shadows=bool(file.renderer.get("shadows", False)),
            moving=moving(self.seen),
        )
        self.matcher = Matcher(self.renderer, self.scene, plan.backend)

    # Physics --------------------------------------------------------------------------------------------------
    def play(self, seeds: Iterable[int], wanted: int | None = None) -> list[Played]:
        """Play the episodes of these seeds, ROWS at a time.

        With `wanted`, playing stops as soon as the first episodes, up to the first unfinished one, have that many
        moments in all.
        """
        todo, every, rows = iter(seeds), list[Played](), list[Played | None]([None] * ROWS)
        self._begin(rows, todo, every)
        while any(rows) and not _enough(every, wanted):
            observation, truth = self.sim.observation(), self._truth()
            intended = self.expert.act(observation)
            executed = intended.copy()
            playing = [(i, episode) for i, episode in enumerate(rows) if episode]
            for i, episode in playing:
                noise = self.plan.noise * episode.noise.standard_normal(len(self.config.dof))
                executed[i] = np.clip(intended[i] + noise, -1, 1)
                episode.moments.append(self._moment(i, truth[i], intended[i], executed[i]))
            rewards, _, _, ended = self.sim.step(executed)
            for i, episode in playing:
                record = episode.record = ended[i]
                success = record is not None and record["success"]
                after = {"next.reward": rewards[i], "next.done": record is not None, "next.success": success}
                episode.moments[-1].values.update(after)
                rows[i] = episode if record is None else None
            self._begin(rows, todo, every)
        return every

    def _begin(self, rows: list[Played | None], todo: Iterator[int], every: list[Played]) -> None:
        """Begin the next episodes in the free rows; append them to `every`."""
        starting = list(zip([i for i, episode in enumerate(rows) if episode is None], todo, strict=False))
        if not starting:
            return
        free, seeds = np.array([i for i, _ in starting]), [seed for _, seed in starting]
        self.sim.reset(free, seeds)
        self.expert.reset(free)
        for i, seed in starting:
            episode = rows[i] = Played(seed, self.sim.drawn[i], stream(seed, "dataset-noise"))
            every.append(episode)

    def _truth(self) -> np.ndarray:
        """Return the ground truth (ROWS, k) as it is for a policy that is told only the goal's nominal place."""
        seen = self.sim.seen
        believed, seen.believed = seen.believed, np.tile(self.sim.nominal_goal, (ROWS, 1))
        truth = self.sim.observation()[PRIVILEGED]
        seen.believed = believed
        return truth

    def _moment(self, row: int, truth: np.ndarray, intended: np.ndarray, executed: np.ndarray) -> Moment:
        sim = self.sim
        seen = sim.seen
        terms = seen.stack.values[:, row].copy()
        unit = sim.observed.term("tip").scale
        # relative to the goal's nominal place: the policy must find the goal
        terms[:, sim.observed["tip"]] += (seen.believed[row] - sim.nominal_goal) / unit
        values = {
            "observation.state": seen.readings()[row],
            "observation.policy": np.clip(terms.reshape(-1), -LIMIT, LIMIT),
            truth_of(()): truth,
            "action": intended,
            "executed.action": executed,
        }
        return Moment(sim.snapshot(row), values)

    # Pictures -------------------------------------------------------------------------------------------------
    def draw(self, episode: Played, look: int, most: int) -> Episode:
        """Return one look of at most `most` moments of an episode, ready to be written."""
        return next(self.develop([self.take(episode, look, most)]))

    def take(self, episode: Played, look: int, most: int) -> Take:
        """Render a look of at most `most` moments without sensor effects, which are applied later."""
        view_seed, moments = look_seed(episode.seed, look), episode.moments[:most]
        record = episode.record if len(moments) == len(episode.moments) else None  # None: cut before its end
        cell = moments[0].cell  # the state in which `redraw` judges each look
        world, refused = redraw(self.seen, self.scene, self.renderer, view_seed, qpos=cell.qpos, bodies=cell.bodies)
        self.matcher.begin(world, cell.bodies)
        shots, matched, pos, axes = [], [], [], []
        sites = [self.renderer.model.site(name).id for name in (self.scene.goal, self.scene.tip_site)]
        for moment in moments:
            views = self.renderer.render(moment.cell.qpos, moment.cell.bodies, moment.cell.qvel)
            data, eyes = self.renderer.data, [views[c.name].pose for c in self.layout.cameras]
            pos.append([*data.site_xpos[sites], *(eye[:3, 3] for eye in eyes)])
            axes.append([*data.site_xmat[sites].reshape(-1, 3, 3), *(eye[:3, :3] for eye in eyes)])
            matched.append(self.matcher.depths(view_seed, moment.cell))
            shots.append({name: replace(shot, normal_of=None, poses=None) for name, shot in views.items()})
            drawn(1)
        # of the goal, the tip and each camera in every frame: (T, 2 + cameras, 7) m and wxyz
        poses = np.concatenate([np.array(pos), quaternion(np.array(axes))], axis=-1)
        frames = [m.values | {f"label.{self.scene.goal}": at[0]} for m, at in zip(moments, poses, strict=True)]
        about = {
            "task": self.task.title,
            "seed": episode.seed,
            "look": look,
            "look_seed": view_seed,
            "redraws": refused,
            "redraws_exhausted": refused >= TRIES,
            "cut": record is None,
            "success": record is not None and record["success"],
            "category": "cut" if record is None else record["category"],
            "peak_force": 0.0 if record is None else record["peak_force"],
            "world": episode.physics.values | world.values,
            "cameras": [to_record(c) for c in self.renderer.cameras],
        }
        clips = {}
        for c in self.layout.cameras:
            own = [shot[c.name] for shot in shots]
            rgb, truth, velocity = (np.stack([getattr(s, key) for s in own]) for key in ("rgb", "depth", "velocity"))
            depth = np.stack([m[c.name] for m in matched]) if c.name in matched[0] else truth
            clips[c.name] = Clip(
                world,
                view_seed,
                rgb,
                depth,
                truth,
                velocity,
                _stacked([s.segmentation for s in own], np.uint8),
                _stacked([s.bodies for s in own], np.uint16),
                _stacked([s.twists for s in own], float),
            )
        by_camera = {
            c.name: [{f"label.{self.scene.held}.{c.name}": at[1], f"label.camera.{c.name}": at[2 + i]} for at in poses]
            for i, c in enumerate(self.layout.cameras)
        }
        return Take(frames, by_camera, clips, about)

    def develop(self, takes: Sequence[Take]) -> Iterator[Episode]:
        """Yield the takes as episodes ready to be written, with sensor effects applied to their images."""
        cameras = self.layout.cameras
        delivered = [sense(c, [take.clips[c.name] for take in takes], self.config.policy_period) for c in cameras]
        for k, take in enumerate(takes):
            recorder = Recorder(self.layout)
            for step, frame in enumerate(take.frames):
                pictures = {}
                for c, clips in zip(cameras, delivered, strict=True):
                    sensed = clips[k]
                    pictures |= take.labels[c.name][sensed.shown[step]]
                    pictures[colour_of(c.name)] = sensed.rgb[step]
                    pictures[depth_of(c.name, ())] = np.clip(sensed.depth[step], 0, FAR)
                    if sensed.parts is not None:
                        pictures[f"label.parts.{c.name}"] = sensed.parts[step]
                recorder.add(frame | pictures)
            yield recorder.finish(take.about)

    def close(self) -> None:
        """Close the renderers."""
        self.matcher.close()
        self.renderer.close()


def _stacked(images: Sequence[np.ndarray | None], dtype: Any) -> np.ndarray | None:
    """Return the arrays of all moments of a clip (T, ...); None without them."""
    some = [image for image in images if image is not None]
    return np.stack(some).astype(dtype) if some else None


def _enough(episodes: Sequence[Played], wanted: int | None) -> bool:
    """Return whether the first episodes, up to the first unfinished one, have `wanted` moments in all."""
    total = 0
    for episode in episodes:
        total += len(episode.moments)
        if wanted is not None and total >= wanted:
            return True
        if episode.record is None:
            return False
    return False


_STAGES: dict[str, Stage] = {}


def _stage(plan: Plan, layout: Layout) -> Stage:
    """Return the stage of a plan; a worker that makes several shards of one plan sets it up once."""
    key = json.dumps(plan.to_json(), sort_keys=True)
    if key not in _STAGES:
        while _STAGES:
            _STAGES.popitem()[1].close()
        _STAGES[key] = Stage(plan, layout)
    return _STAGES[key]
