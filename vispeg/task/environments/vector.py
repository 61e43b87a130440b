"""The task as a gymnasium vector environment, whose environments are the rows of one batched simulation."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from vispeg.core.errors import UserError
from vispeg.core.seeds import check_seed, stream
from vispeg.interface.terms import LIMIT, MEASURED, POLICY, PRIVILEGED
from vispeg.render.cameras.camera import Camera
from vispeg.render.cameras.rig import CameraRig
from vispeg.render.image_kinds import DEPTH, MODES, grey_depth
from vispeg.render.image_kinds import kind_of as kind_of_image
from vispeg.render.snapshot import Snapshot
from vispeg.task.config import TaskConfig
from vispeg.task.environments.divergence import leave
from vispeg.task.environments.simulation import Push, TaskSimulation
from vispeg.task.eyes import image_spaces, rig_of
from vispeg.task.registry import config_of, kind_of, task_of
from vispeg.task.start import Start
from vispeg.task.terms import Observation
from vispeg.task.world_file import WorldFile, load_world
from vispeg.worlds.randomized import RandomizedEffect, RandomizedWorld
from vispeg.worlds.world import World


def spaces(
    config: TaskConfig,
    obs_mode: str,
    cameras: Sequence[Any],
    privileged: bool = False,
    depth_image: bool = False,
    measured: int = 0,
) -> tuple[gym.spaces.Dict, gym.spaces.Box]:
    """Return the observation space and the action space of one environment.

    Args:
        config: settings of the task.
        obs_mode: observation mode.
        cameras: the cameras of its images.
        privileged, depth_image: as for TaskVec.
        measured: number of readings in SI units; 0 to leave them out.
    """
    box = gym.spaces.Box
    observed = Observation(task_of(config).terms, config)
    parts: dict[str, gym.Space] = {
        POLICY: box(-LIMIT, LIMIT, (config.stack * observed.policy_size,), np.float32),
    }
    if privileged:
        parts[PRIVILEGED] = box(-LIMIT, LIMIT, (observed.truth_size,), np.float32)
    if measured:
        parts[MEASURED] = box(-np.inf, np.inf, (measured,), np.float32)
    parts |= image_spaces(obs_mode, cameras)
    if depth_image:
        depths = {k: space for k, space in parts.items() if kind_of_image(k) is DEPTH}
        parts |= {k: box(0, 255, space.shape or (), np.uint8) for k, space in depths.items()}
    return gym.spaces.Dict(parts), box(-1.0, 1.0, (len(config.dof),), np.float32)


def world_of(
    world: World | RandomizedWorld | str | Path | None,
    settings: Mapping[str, Any],
    arguments: Iterable[str] | None = None,
) -> tuple[RandomizedWorld, TaskConfig, WorldFile | None]:
    """Return a world, the settings of its task, and its file (None for a World object).

    Args:
        world: a World or RandomizedWorld, a built-in world's name, or a file; `nominal` if None.
        settings: settings of the task that replace the world's.
        arguments: names of the caller's other keyword arguments, which an error for an unknown name in `settings`
            lists as choices; None to skip that check.

    Raises:
        UserError: as `load_world`; errors do not name the file if there are `settings`, which may be the cause.
    """
    if isinstance(world, World | RandomizedWorld):
        file, world = None, RandomizedWorld.of(world)
        merged = {"robot": world.base.robot, **settings}
    else:
        file = load_world(world if world is not None else "nominal")
        world, merged = file.world, {**file.task, **settings}
    if arguments is not None:
        check_names(settings, arguments, kind_of(merged))
    return world, config_of(merged, None if settings or file is None else str(file.path)), file


MEANT = {  # name in other libraries -> name here, where the spelling is too different to guess
    **dict.fromkeys(("modality", "observation", "observations", "sensors", "images"), "obs_mode"),
    **dict.fromkeys(("env", "scenario", "domain", "randomization", "domain_randomization"), "world"),
    **dict.fromkeys(("n_envs", "nenv", "batch_size", "rows"), "num_envs"),
    **dict.fromkeys(("horizon", "max_steps", "episode_length"), "steps"),
    **dict.fromkeys(("resolution", "width", "height", "img_size"), "image_size"),
    **dict.fromkeys(("threads", "num_threads", "n_threads"), "nthread"),
    **dict.fromkeys(("physics", "simulator"), "engine"),
    "renderer": "backend",
    "frame_stack": "stack",
}
TOLERANCE = ("tolerance", "gap", "play")  # other words for a tolerance; `TaskConfig.tolerance` names its setting


def check_names(names: Iterable[str], others: Iterable[str], kind: type[TaskConfig]) -> None:
    """Raise UserError for a keyword argument that is neither a field of the task's settings nor among `others`."""
    choices = (*others, *(f.name for f in fields(kind)))
    meant = MEANT if kind.tolerance is None else {**MEANT, **dict.fromkeys(TOLERANCE, kind.tolerance.setting)}
    for name in names:
        if name not in choices:
            raise UserError("no such setting of the task", got=name, choices=choices, meant=meant.get(name, ""))


OPTIONS = ("reset_mask", "start")  # of `TaskVec.reset`
# entries of an episode's record that `infos` also holds as arrays
IN_INFOS = ("success", "category", "seed", "time", "peak_force", "lateral_error", "depth")


class TaskVec(VectorEnv):
    """`num_envs` environments of a world's task, stepped together.

    Args:
        num_envs: number of environments.
        world: a World or RandomizedWorld, a built-in world's name, or a world file; by default `nominal`.
        obs_mode: `state`, `proprio`, `depth`, `rgb` or `rgbd`.
        seed: row i's first episode has seed + i, until `reset` is given a seed; None draws a new one for each TaskVec.
            The info of `reset` holds the seeds.
        autoreset_mode: NEXT_STEP (gymnasium's default: the step after an episode's end begins the next one), SAME_STEP
            (the observation at the end is in `infos["final_obs"]`) or DISABLED.
        nthread: threads of the physics.
        engine: of the physics: `c`, MuJoCo, or `warp`, MuJoCo Warp (extra `warp`), for many environments on a GPU.
        backend: of the renderer, for image modes.
        render_mode: None or `rgb_array`.
        dump: folder in which episodes that diverge are saved for `vispeg.task.environments.replay.replay`.
        privileged: whether observations hold the ground truth, for critics and teachers; a real robot does not have it.
        depth_image: whether depth comes as uint8 images, for libraries that expect these; see
            `vispeg.render.image_kinds.grey_depth`.
        measured: whether observations hold readings in SI units, like `observation.state` of rendered datasets; see
            `vispeg.interface.observer.Observer.readings`.
        **settings: fields of the task's TaskConfig that replace the world's.
    """

    def __init__(
        self,
        num_envs: int = 1,
        world: World | RandomizedWorld | str | Path | None = None,
        obs_mode: str = "state",
        seed: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        nthread: int = 1,
        engine: str = "c",
        backend: str = "auto",
        render_mode: str | None = None,
        dump: str | Path | None = None,
        privileged: bool = False,
        depth_image: bool = False,
        measured: bool = False,
        **settings: Any,
    ):
        arguments = {"num_envs": num_envs, "world": world, "obs_mode": obs_mode, "seed": seed, "nthread": nthread}
        arguments |= {"autoreset_mode": autoreset_mode, "backend": backend, "render_mode": render_mode, "dump": dump}
        arguments |= {"privileged": privileged, "depth_image": depth_image, "measured": measured, "engine": engine}
        self._arguments = {**arguments, **settings}
        if obs_mode not in MODES:
            raise UserError("unknown observation mode", key="obs_mode", got=obs_mode, choices=MODES)
        if render_mode not in (None, "rgb_array"):
            raise UserError("unknown render mode", key="render_mode", got=render_mode, choices=("rgb_array",))
        resets = {mode.value: mode for mode in AutoresetMode}
        if autoreset_mode not in (*resets, *resets.values()):
            raise UserError("unknown way of resetting", key="autoreset_mode", got=autoreset_mode, choices=resets)
        if num_envs < 1:
            raise UserError("must be at least 1", key="num_envs", got=num_envs)
        self.world, self.config, self.file = world_of(world, settings, arguments)
        self.num_envs, self.obs_mode, self.render_mode, self.dump = num_envs, obs_mode, render_mode, dump
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {"render_modes": ["rgb_array"], "render_fps": 1 / self.config.policy_period}
        self.metadata["autoreset_mode"] = self.autoreset_mode
        self.sim = TaskSimulation(self.world, self.config, num_envs, obs_mode, nthread, engine)
        self.eyes = self.rig(backend=backend)
        # more rigs of the same cameras, each with looks of its own; their images have the keys `KEY@1`, `KEY@2`, ...
        self.further: list[CameraRig] = []
        readings = self.sim.seen.readings().shape[1] if measured else 0
        self.single_observation_space, self.single_action_space = spaces(
            self.config, obs_mode, self.eyes.cameras, privileged, depth_image, readings
        )
        self.keys = tuple(self.single_observation_space)
        self.privileged, self.depth_image, self.measured = privileged, depth_image, measured
        self.observed = self.sim.observed  # the terms of the observations
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        if seed is None:  # as in gymnasium: two environments without a seed do not play the same episodes
            seed = int(np.random.SeedSequence().generate_state(1)[0])
        self._base = np.array(_seeds(seed, num_envs), np.int64)
        self._episode = np.zeros(num_envs, dtype=np.int64)
        self._ended = np.zeros(num_envs, dtype=bool)
        self._started = np.zeros(num_envs, dtype=bool)  # whether the row has had an episode

    # Episodes -------------------------------------------------------------------------------------------------
    def reset(
        self, *, seed: int | Sequence[int | None] | np.ndarray | None = None, options: dict[str, Any] | None = None
    ):
        """Begin an episode in every row, or in those of `options["reset_mask"]` (num_envs,) bool.

        `options["start"]`, a `vispeg.task.start.Start` or one for each row (None for a row without), sets the joints,
        the goal, the believed goal and the effects of episodes. The seed decides everything that it leaves open.

        Args:
            seed: row i's episode has seed + i; or a seed for each row. None goes on to each row's next episode.
            options: see above.

        Returns:
            The observations, and infos with every row's `seed` and, for the rows that began, the drawn values of their
            `world`.

        Raises:
            UserError: an impossible start, an unknown option, or seeds or a mask that are not one for each row.
        """
        options = options or {}
        if unknown := options.keys() - set(OPTIONS):
            raise UserError("unknown option", key="options", got=min(unknown), choices=OPTIONS)
        rows = np.flatnonzero(_mask(options.get("reset_mask"), self.num_envs))
        seeds, starts = _seeds(seed, self.num_envs), _starts(options.get("start"), self.num_envs)
        for i in rows:
            if (first_seed := seeds[i]) is not None:
                self._base[i], self._episode[i] = first_seed, 0
            elif self._started[i]:
                self._episode[i] += 1
        self._started[rows] = True
        self._begin(rows, starts)
        worlds = np.full(self.num_envs, None, dtype=object)
        for i in rows:
            worlds[i] = self.drawn(int(i)).values
        return self._observe(), {"seed": self.sim.seeds.copy(), "world": worlds}

    def _begin(self, rows: np.ndarray, starts: Mapping[int, Start] | None = None) -> None:
        self.sim.reset(rows, [episode_seed(int(self._base[i]), int(self._episode[i])) for i in rows], starts)
        snapshots = self._snapshots(rows)
        for rig in (self.eyes, *self.further):
            rig.begin(snapshots, {row: int(self.sim.seeds[row]) for row in snapshots}, self.sim.levels)
            rig.look(snapshots)
        self._ended[rows] = False

    def step(self, actions: np.ndarray):
        """Advance every row by one policy step; `infos` holds the records of episodes that ended in it.

        Args:
            actions: (num_envs, k), cut to -1 to 1.

        Raises:
            UserError: actions of another shape, or that are not finite.
        """
        waiting = np.flatnonzero(self._ended)
        rewards, terminated, truncated, records = self.advance(actions)
        self.look(np.setdiff1d(np.arange(self.num_envs), waiting))
        infos: Any = {}
        if len(waiting) and self.autoreset_mode == AutoresetMode.NEXT_STEP:
            rewards[waiting], terminated[waiting], truncated[waiting] = 0.0, False, False
            self._episode[waiting] += 1
            self._begin(waiting)
        for i in waiting:  # its record was given when the episode ended
            records[i] = None
        for i, record in enumerate(records):
            if record is not None:  # force profiles differ in length, so the record is one object, not arrays
                infos = self._add_info(infos, {k: record[k] for k in IN_INFOS}, i)
                infos.setdefault("record", np.full(self.num_envs, None, dtype=object))[i] = record
                infos["_record"] = infos["_success"]  # gymnasium's mask of the rows that have the entry
        self._ended = terminated | truncated
        if self.autoreset_mode == AutoresetMode.DISABLED:
            self._ended[waiting] = True  # until its reset
        if self._ended.any() and self.autoreset_mode == AutoresetMode.SAME_STEP:
            rows, final = np.flatnonzero(self._ended), self._observe()
            infos["final_obs"] = {k: v.copy() for k, v in final.items()}
            infos["_final_obs"] = self._ended.copy()
            self._episode[rows] += 1
            self._begin(rows)
        return self._observe(), rewards, terminated, truncated, infos

    def advance(self, actions: np.ndarray):
        """Simulate one policy step without resets or images, and save episodes that diverged in it in `dump`.

        Returns:
            As `TaskSimulation.step`; records also hold the drawn looks.

        Raises:
            UserError: as `step`.
        """
        actions = np.asarray(actions, dtype=float)
        if actions.shape != self.action_space.shape:
            raise UserError(
                "not actions", key="actions", expected=f"shape {self.action_space.shape}", got=actions.shape
            )
        if not np.isfinite(actions).all():
            row = int(np.argwhere(~np.isfinite(actions))[0][0])
            raise UserError("not finite", key=f"actions[{row}]", expected="-1 to 1", got=actions[row].tolist())
        out = self.sim.step(actions)
        for row, record in enumerate(out[3]):
            if record is None:
                continue
            record["world"] |= self.eyes.drawn[row].values
            ended_before = self._ended[row]  # this row waits for its reset, and its episode is already saved
            if self.dump is not None and record["category"] == "diverged" and not ended_before:
                record["replay"] = str(leave(Path(self.dump), self.sim, row, self.drawn(row), self.file))
        return out

    def _observe(self) -> dict[str, np.ndarray]:
        images = self.eyes.see()
        images |= {f"{key}@{k}": v for k, rig in enumerate(self.further, 1) for key, v in rig.see().items()}
        if self.depth_image:
            images = {key: grey_depth(v) if kind_of_image(key) is DEPTH else v for key, v in images.items()}
        values = self.sim.observation()
        if self.measured:
            values[MEASURED] = self.sim.seen.readings().astype(np.float32)
        return {**{k: v for k, v in values.items() if self.privileged or k != PRIVILEGED}, **images}

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """The cameras of the images as calibrated, which policies may know; empty without images."""
        return self.eyes.cameras

    def views(self) -> Mapping[str, Mapping[str, np.ndarray]]:
        """Return the true cameras of the present images, with the errors that their episodes drew, by camera name.

        This is ground truth: a policy under evaluation may only use `cameras`.

        Returns:
            `K` (num_envs, 3, 3), px; `distortion` (num_envs, 5); `base_T_camera` (num_envs, 4, 4), pose of the camera
            axes (x right, y down, z forward) in the base, m.
        """
        return self.eyes.views()

    # Pictures -------------------------------------------------------------------------------------------------
    def rig(self, look_seed: Callable[[int], int] | None = None, backend: str | None = None) -> CameraRig:
        """Make another camera rig for this environment's rows.

        Args:
            look_seed: episode's seed -> seed of its look; None for the same seed.
            backend: of the renderer; None for the environment's.
        """
        backend = self.eyes.backend if backend is None else backend
        where = self.sim.scene, self.config, self.world, self.obs_mode, self.num_envs
        return rig_of(*where, file=self.file, backend=backend, look_seed=look_seed)

    @property
    def longest(self) -> int:
        """The number of policy steps after which an episode ends in any case."""
        return self.config.steps

    @property
    def ranges(self) -> tuple[RandomizedEffect, ...]:
        """The ranges that episodes draw from: of the physics, and with cameras also of what these see."""
        return (*self.sim.world.ranges, *self.eyes.world.ranges)

    def drawn(self, row: int) -> World:
        """Return the world of a row's present episode, with its physical and its optical effects."""
        return self.sim.drawn[row].add(*self.eyes.drawn[row].effects)

    def look(self, rows: Sequence[int] | np.ndarray) -> None:
        """Take images of these rows in their present state."""
        snapshots = self._snapshots(rows)
        for rig in (self.eyes, *self.further):
            rig.look(snapshots)

    def _snapshots(self, rows: Sequence[int] | np.ndarray) -> dict[int, Snapshot]:
        return {int(row): self.sim.snapshot(int(row)) for row in rows} if self.eyes.cameras else {}

    # Changes --------------------------------------------------------------------------------------------------
    def set_level(self, level: float | dict[str, float]) -> None:
        """Scale how far the ranges of the next episodes extend from nominal: 0 to 1, for all ranges or by label.

        Raises:
            UserError: a level out of 0 to 1.
        """
        for key, value in level.items() if isinstance(level, dict) else [("level", level)]:
            if not 0.0 <= value <= 1.0:
                raise UserError("impossible level", key=key, expected="0 to 1", got=value)
        self.sim.levels = level

    def push(self, rows: Sequence[int], force: Sequence[float], start: float, duration: float) -> None:
        """Push these rows' flanges in their present episode.

        Args:
            rows: indices.
            force: (3,) N, world frame.
            start, duration: s, start since the episode began.

        Raises:
            UserError: no such row, or no force.
        """
        for i in rows:
            self._check_row(i)
        if np.shape(force) != (3,):
            raise UserError("not a force", key="force", expected="three numbers, N", got=force)
        for i in rows:
            self.sim.push[i] = Push(np.asarray(force, float), start, duration)

    def disturb(self, row: int, torque: np.ndarray) -> None:
        """Apply torques (k, nj) N m to the links of a row's arm in its present episode.

        Each acts for one control period; after the last the sequence starts again.

        Raises:
            UserError: no such row, or torques of another shape.
        """
        self._check_row(row)
        torque, joints = np.asarray(torque, float), self.sim.home.shape[1]
        if torque.ndim != 2 or not len(torque) or torque.shape[1] != joints:
            raise UserError("not torques", key="torque", expected=f"shape (k, {joints})", got=torque.shape)
        self.sim.disturbed[row] = torque

    def _check_row(self, row: int) -> None:
        if not 0 <= row < self.num_envs:
            raise UserError("no such row", key="row", expected=f"0 to {self.num_envs - 1}", got=row)

    def render(self):
        """Return an RGB image (H, W, 3) uint8 per row from a camera that overlooks the cell; None without a render
        mode.
        """
        if self.render_mode is None:
            return None
        return tuple(self.eyes.picture(i, self.sim.snapshot(i)) for i in range(self.num_envs))

    def close_extras(self, **kwargs: Any) -> None:
        """Free the renderers."""
        for rig in (self.eyes, *self.further):
            rig.close()

    def __getstate__(self):
        return self._arguments  # a copy is a new environment, not in the same state

    def __setstate__(self, arguments):
        self.__init__(**arguments)


def _seeds(stated: int | Sequence[int | None] | np.ndarray | None, rows: int) -> list[int | None]:
    """Return a seed, or None, for each row. Raises UserError: not an integer, or not one for each row."""
    if stated is None:
        return [None] * rows
    each = np.ravel(np.array(stated, object)).tolist()
    if isinstance(stated, int | np.integer):
        each = [stated + i for i in range(rows)]
    if len(each) != rows or not all(one is None or isinstance(one, int | np.integer) for one in each):
        raise UserError("not seeds", key="seed", expected=f"an integer, or {rows} of them", got=stated)
    for one in each:
        if one is not None:
            check_seed(one, "seed")
    return [None if one is None else int(one) for one in each]


def _mask(stated: Sequence[bool] | np.ndarray | None, rows: int) -> np.ndarray:
    """Return which rows to reset, all of them for None. Raises UserError: not a bool for each row."""
    mask = np.ones(rows, bool) if stated is None else np.asarray(stated)
    if mask.shape != (rows,) or mask.dtype != bool:
        raise UserError("not a mask", key="options.reset_mask", expected=f"{rows} of True or False", got=stated)
    return mask


def _starts(stated: Start | Sequence[Start | None] | None, rows: int) -> dict[int, Start]:
    """Return row -> start for the rows that have one. Raises UserError: not a Start, or not one for each row."""
    each = [stated] * rows if stated is None or isinstance(stated, Start) else list(stated)
    if len(each) != rows or not all(one is None or isinstance(one, Start) for one in each):
        expected = f"a vispeg.task.start.Start, or {rows} of them"
        raise UserError("not a start", key="options.start", expected=expected, got=type(stated).__name__)
    return {row: one for row, one in enumerate(each) if one is not None}


def episode_seed(base: int, episode: int) -> int:
    """Return the seed of a row's episode number `episode`; for number 0 it is `base` itself."""
    if episode == 0:
        return int(base)
    return int(stream(int(base), "episode", int(episode)).integers(2**31))
