"""The simulation of a task on a batch of cells: it starts episodes, applies actions and computes observations."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.effects.common.springs import sprung
from vispeg.interface.observer import DOWN, RECENT, Observer
from vispeg.interface.terms import LIMIT, POLICY, PRIVILEGED, policy_part
from vispeg.render.image_kinds import GOAL_TOLD, MODES
from vispeg.render.snapshot import Snapshot
from vispeg.sim.compiled import compiled, nominal_of
from vispeg.sim.quiet import quiet
from vispeg.sim.reach import reach
from vispeg.task.cell import Cell
from vispeg.task.config import TaskConfig
from vispeg.task.control import PoseControl
from vispeg.task.guards import Guards
from vispeg.task.kinematics import chain_of, tool_weight
from vispeg.task.registry import task_of
from vispeg.task.result import EpisodeResult
from vispeg.task.rewards import Moment
from vispeg.task.start import ABOVE, Start, home
from vispeg.task.terms import Observation
from vispeg.worlds.randomized import RandomizedWorld
from vispeg.worlds.split import physical
from vispeg.worlds.world import World

AWAY = 2.0  # m, distance of the tip from the goal along an axis beyond which the simulation counts as diverged


@dataclass(frozen=True)
class Push:
    """A constant force on the flange for some time.

    Attributes:
        force: (3,) N, world frame.
        start: s since the episode began.
        duration: s.
    """

    force: np.ndarray
    start: float
    duration: float


class TaskSimulation:
    """`nsim` independent episodes of a task, one per row of a batch; each row ends and begins on its own.

    Args:
        world: the effects of episodes. Only the physical ones are used here, the optical ones in `CameraRig`.
        config: settings of the task, which also decide the robot and the cell.
        nsim: number of rows.
        obs_mode: observation mode; it decides whether policies are told the goal or only its nominal place.
        nthread: threads of the physics.
        engine: of the physics, see `vispeg.sim.engine`.
    """

    def __init__(
        self,
        world: World | RandomizedWorld,
        config: TaskConfig,
        nsim: int,
        obs_mode: str = "state",
        nthread: int = 1,
        engine: str = "c",
    ):
        cameras = config.cameras if MODES[obs_mode] else ()
        self.world, self.nsim, self.obs_mode = physical(RandomizedWorld.of(world)), nsim, obs_mode
        self.config: Any = config  # of the task's own class
        self.task = task_of(config)
        self.scene = self.task.cell(config, cameras)
        self.observed, self.reward = Observation(self.task.terms, config), config.rewards.of(config.reward)
        self.levels: Mapping[str, float] | float = 1.0  # share of the world's ranges, see `TaskVec.set_level`
        self.drawn = [self.world.sample(0, self.scene)] * nsim  # the world of each row's present episode
        self.nthread, self.engine = nthread, engine
        posture = home(self.scene)
        self.control = PoseControl(self.scene.nominal, nsim, config, posture, nthread)
        self.guards = Guards(config, self.scene, nsim)
        self.solo = nominal_of(self.scene.nominal, 1)
        self.nominal_goal = np.array(self.scene.target)
        tip = self.nominal_goal + [0, 0, ABOVE + self.scene.tip]
        rest = np.tile(tip, (nsim, 1)), np.tile(DOWN, (nsim, 1))
        self.home = reach(self.control.nominal, *rest, np.tile(posture, (nsim, 1)))[0]
        self.control.home = self.home[0]
        self.cell = self._cell({e.effect for e in self.world.entries})
        n, size = nsim, self.observed.policy_size
        chain = chain_of(self.scene.nominal)
        self.seen = Observer(config, chain, self.scene.tip, tool_weight(self.scene), size, n)
        self.seeds, self.count = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=int)
        self.tracks = [self.task.track() for _ in range(n)]
        self.diverged = np.zeros(n, dtype=bool)
        self.seen.see(self.home.copy(), np.zeros_like(self.home))
        self.push: list[Any] = [None] * n
        self.starts: list[Start | None] = [None] * n  # stated for the present episodes
        # by row: (k, nj) N m, a torque per control period, repeated from the first after the last
        self.disturbed: list[np.ndarray | None] = [None] * n
        self.acted: list[list[np.ndarray]] = [[] for _ in range(n)]  # actions of the present episodes
        # called after each control tick with the q and dq that the controller read, and the wrench after the tick
        self.heard: Callable[..., None] | None = None

    def _cell(self, names: Collection[str]) -> Cell:
        """Build the batch of cells; only effects of these names can be active in its rows."""
        c = self.config
        h, tick = c.control_period / c.substeps, c.control_period
        cell = Cell(self.scene, self.drawn, h, tick, self.nthread, sorted(names), self.engine)
        weight = self.control.nominal.gravity(self.home).copy()
        mass = self.control.nominal.operational(self.home)[0]
        apparent = 1.0 / np.diagonal(np.linalg.inv(mass), axis1=1, axis2=2)
        cell.start(self.home, np.zeros_like(self.home), weight, apparent)
        return cell

    # Episodes -------------------------------------------------------------------------------------------------
    def reset(self, rows: np.ndarray, seeds: Sequence[int], starts: Mapping[int, Start] | None = None) -> None:
        """Begin new episodes in some rows.

        Args:
            rows: indices of the rows.
            seeds: of their episodes.
            starts: by row, a start to use in place of what the seed draws.

        Raises:
            UserError: an impossible start.
        """
        if not len(rows):
            return
        pos = np.tile(self.nominal_goal + [0, 0, 0.1], (self.nsim, 1))  # a pose in reach for rows that do not begin
        starts, worlds = starts or {}, []
        for row, seed in zip(rows, seeds, strict=True):
            rng = stream(int(seed), "start")
            pos[row] = self.nominal_goal + self.task.start(self.config, self.config.start_radius, rng)
            drawn = self.world.sample(int(seed), self.scene, self.levels)
            worlds.append(self._stated_world(drawn, starts[row]) if row in starts else drawn)
            self.drawn[row], self.seeds[row] = worlds[-1], seed
            self.tracks[row], self.push[row], self.acted[row] = self.task.track(), None, []
            self.disturbed[row], self.starts[row] = None, starts.get(row)
        self.guards.reset(rows)
        pos[:, 2] += self.scene.tip
        q, weight = self._start(rows, pos)
        self._set_stated_angles(rows, starts, pos, q, weight)
        self._make_effects_possible(rows, worlds)
        self.cell.begin(rows, worlds, q, weight)
        self.seen.begin(rows, pos)
        self.count[rows], self.diverged[rows] = 0, False
        self._set_believed_goal(rows, starts)
        self.cell.read()
        begun = np.isin(np.arange(self.nsim), rows)[:, None]  # the other rows keep their last measurement
        true = self.cell.x.q, self.cell.x.dq
        q, dq = (np.where(begun, new, old) for new, old in zip(true, self.seen.measured, strict=True))
        self.seen.see(q, dq)
        self.seen.stack.fill(rows, self.observed.read(self, self.observed.policy))

    def _stated_world(self, drawn: World, start: Start) -> World:
        """Return the world of an episode that begins with `start`, from the world that its seed drew.

        Raises:
            UserError: a goal out of the range of the effect that moves it.
        """
        world = drawn if start.effects is None else physical(World(drawn.robot, drawn.tool, start.effects, drawn.cell))
        if start.goal is None:
            return world
        kind = effect(self.scene.offset)
        (where,) = kind.targets(self.scene)
        shift = np.asarray(start.goal, float) - self.nominal_goal
        for axis, value in zip("xyz", shift, strict=True):
            param = kind.params[axis]
            if not param.low <= value <= param.high:
                expected = f"within {param.high:g} m of {self.nominal_goal.round(4).tolist()}"
                got = np.asarray(start.goal).tolist()
                raise UserError(
                    "a goal out of this cell's range", file=start.source, key="goal", expected=expected, got=got
                )
        return world.add(EffectInstance.of(kind.name, where, **dict(zip("xyz", map(float, shift), strict=True))))

    def _set_stated_angles(
        self, rows: np.ndarray, starts: Mapping[int, Start], pos: np.ndarray, q: np.ndarray, weight: np.ndarray
    ) -> None:
        """Overwrite the rows whose start states joint angles.

        Args:
            rows: indices of the rows that begin.
            starts: by row.
            pos: (nsim, 3) m, flange positions; changed in place.
            q, weight: (len(rows), nj) rad and N m, joint angles and gravity torque; changed in place.

        Raises:
            UserError: angles that are not a posture of this arm.
        """
        for i, row in enumerate(rows):
            if row in starts and (stated := starts[row].q) is not None:
                stated = np.asarray(stated, float)
                low, high = self.scene.range.T
                if stated.shape != q[i].shape or not ((stated >= low) & (stated <= high)).all():
                    expected = f"{len(q[i])} angles within the joints' limits, rad"
                    got = stated.tolist()
                    raise UserError(
                        "not a posture of this arm", file=starts[row].source, key="q", expected=expected, got=got
                    )
                q[i], weight[i] = stated, self.solo.gravity(stated[None])[0]
                pos[row] = self.seen.chain.pose(stated[None], np.zeros((1, len(stated))))[0][0]

    def _make_effects_possible(self, rows: np.ndarray, worlds: Sequence[World]) -> None:
        """Rebuild the batch of cells if one of these worlds has an effect that it was not built for.

        Raises:
            UserError: a new effect is needed while other rows are in an episode.
        """
        new = {e.effect for world in worlds for e in world.effects} - set(self.cell.names)
        if new:
            if len(rows) < self.nsim:
                expected = "a world with these effects, or all rows at once"
                raise UserError(
                    "effects that this environment's world does not have", expected=expected, got=sorted(new)
                )
            self.cell = self._cell({*self.cell.names, *new})

    def _start(self, rows: np.ndarray, pos: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Solve for the joint angles that put these rows' flanges at `pos` (nsim, 3) m, pointing straight down.

        Returns:
            Angles (len(rows), nj) rad and the gravity torque there (len(rows), nj) N m.

        Raises:
            UserError: a position out of the arm's reach.
        """
        few = 4 * len(rows) < self.nsim  # then one arm after the other is cheaper than the batch; same result
        q, weight = self.home.copy(), np.zeros_like(self.home)
        for group in rows[:, None] if few else [np.arange(self.nsim)]:
            nominal = self.solo if few else self.control.nominal
            q[group], error = reach(nominal, pos[group], np.tile(DOWN, (len(group), 1)), q[group])
            low, high = self.scene.range.T
            error = np.where(((q[group] < low) | (q[group] > high)).any(axis=1), np.inf, error)
            starting = np.isin(group, rows)
            if error[starting].max() > 1e-4:
                place = pos[group[starting][int(error[starting].argmax())]]
                raise UserError("the start is out of the arm's reach", got=place.round(3))
            weight[group] = nominal.gravity(q[group])
        return q[rows], weight[rows]

    def _set_believed_goal(self, rows: np.ndarray, starts: Mapping[int, Start]) -> None:
        """Set the goal that policies of these rows are told: the start's, else that of the observation mode."""
        self.seen.believed[rows] = self._told_goal()[rows]
        for row in rows:
            if row in starts and (believed := starts[row].believed) is not None:
                self.seen.believed[row] = believed

    def _told_goal(self) -> np.ndarray:
        """Return the goal (nsim, 3) m that the observation mode tells: the nominal one, or the true one with errors."""
        if self.obs_mode not in GOAL_TOLD:
            return np.tile(self.nominal_goal, (self.nsim, 1))
        goal = self.cell.site_position("goal")
        for a in self.cell.active:
            if a.effect.overrides("believe"):
                goal = a.effect.believe(goal, a.p)
        return goal

    def step(self, action: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[EpisodeResult | None]]:
        """Simulate one policy step of every row.

        Args:
            action: (nsim, len(dof)) in [-1, 1].

        Returns:
            Reward (nsim,), terminated and truncated (nsim,) bool, and for each row the record of the episode that
            ended in this step, or None.
        """
        c, seen = self.config, self.seen
        motion = seen.asked(action)
        for acted, executed in zip(self.acted, seen.action, strict=True):
            acted.append(executed)
        seen.hold(*self.task.command(self, motion))
        force, wrenches = np.empty((c.ticks, self.nsim, 3)), np.empty((c.ticks, self.nsim, 6))
        with quiet(), np.errstate(all="ignore"):
            for k in range(c.ticks):
                wrenches[k], force[k] = self.tick(k)
            self.cell.read()
            self.seen.see(*self.cell.measure())
            return self.settle(force, wrenches)

    def tick(self, k: int = 0, measured: tuple[np.ndarray, np.ndarray] | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Simulate one control period towards the commanded pose.

        Args:
            k: index of the control period in the policy step.
            measured: joint angles and velocities q, dq (nsim, nj) for the controller, rad and rad/s; None to read the
                encoders here.

        Returns:
            Reading of the wrist's sensor (nsim, 6) N and N m, and true contact force (nsim, 3) N, at the period's end.
        """
        cell = self.cell
        cell.read()
        if self.guards.on:
            self.guards.tick(cell.x.q, cell.x.dq)
        q, dq = cell.measure() if measured is None else measured
        if any(p is not None for p in self.push):
            self._pushes(k)
        if any(torques is not None for torques in self.disturbed):
            self._disturbances(k)
        cell.advance(self.control.torque(q, dq, self.seen.goal, self.seen.rot), self.config.substeps)
        felt = cell.felt()
        if self.heard is not None:
            self.heard(q, dq, felt)
        return felt, cell.sensors[:, 7:10]

    def _pushes(self, k: int) -> None:
        for row, push in enumerate(self.push):
            if push is not None:
                t = (self.count[row] * self.config.ticks + k) * self.config.control_period
                self.cell.external[row] = push.force if push.start <= t < push.start + push.duration else 0.0

    def _disturbances(self, k: int) -> None:
        cell = self.cell
        if cell.beside is None:
            cell.beside = np.zeros_like(cell.x.q)
        for row, torques in enumerate(self.disturbed):
            if torques is not None:
                cell.beside[row] = torques[(self.count[row] * self.config.ticks + k) % len(torques)]

    def settle(
        self, force: np.ndarray, wrenches: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[EpisodeResult | None]]:
        """Finish a policy step: compute reward, ends of episodes and observations. The observer must be up to date.

        Args:
            force: (ticks, nsim, 3) N, true contact force at each control tick.
            wrenches: (ticks, nsim, 6) N and N m, reading of the wrist's sensor at each control tick.

        Returns:
            As `step`.
        """
        c, cell = self.config, self.cell
        forces = np.linalg.norm(force, axis=2)
        self.guards.pose(self.seen.jac)
        self.count += 1
        tip = self.tip_in_goal()
        bad = ~np.isfinite(cell.qpos).all(axis=1) | ~np.isfinite(forces).all(axis=0) | (np.abs(tip).max(axis=1) > AWAY)
        bad |= ~np.isfinite(tip).all(axis=1) | cell.unstable()
        self.diverged |= bad
        # finite numbers, so that the reward and the record of a diverged row are finite
        forces = np.where(bad, 0.0, forces)
        tip = np.where(bad[:, None], 0.5, tip)
        self.seen.feel(wrenches[-RECENT:])
        goal = self.task.goal(c)
        rewards = self.reward.dense(Moment(tip, goal, forces.max(axis=0), self.seen.action, c.reward_scale, self))
        observed = {name: np.nan_to_num(value) for name, value in self.task.observed(self).items()}
        terminated, truncated = np.zeros(self.nsim, dtype=bool), self.count >= c.steps
        records: list[EpisodeResult | None] = [None] * self.nsim
        for i, track in enumerate(self.tracks):
            track.add(c, forces[:, i], tip[i], **{name: float(value[i]) for name, value in observed.items()})
            category = "diverged" if self.diverged[i] else self.guards.stopped[i] or track.verdict(c)
            terminated[i] = category is not None
            if category is not None:
                rewards[i] += self.reward.success if category == "success" else self.reward.abort
            elif truncated[i]:
                category = track.at_time(c)
            if category is not None:
                records[i] = self._record(i, category)
        self.seen.stack.push(self.observed.read(self, self.observed.policy))
        return rewards, terminated, truncated & ~terminated, records

    def _record(self, i: int, category: str) -> EpisodeResult:
        t = self.tracks[i]
        return {
            "success": category == "success",
            "category": category,
            "seed": int(self.seeds[i]),
            "time": float(self.count[i] * self.config.policy_period),
            "peak_force": t.peak,
            "lateral_error": t.lateral,
            "depth": t.depths[-1],
            "clipped": float(self.seen.clipped[i] / self.count[i]),
            # not an array: gymnasium would stack arrays, but these differ in length
            "force_profile": tuple(np.concatenate(t.forces).tolist()),
            "world": self.drawn[i].values,
        }

    # Observations ---------------------------------------------------------------------------------------------
    def tip_in_goal(self) -> np.ndarray:
        """Return the tip's true position (nsim, 3) m in the goal's frame; z is negative below the goal's plane."""
        offset = self.cell.site_position("tip") - self.cell.site_position("goal")
        return np.einsum("nji,nj->ni", self.cell.site_rotation("goal"), offset)

    def tilt(self) -> np.ndarray:
        """Return the angle (nsim,) rad between the tip's axis and the goal's axis."""
        along = np.einsum("nj,nj->n", self.cell.site_rotation("tip")[:, :, 2], self.cell.site_rotation("goal")[:, :, 2])
        return np.arccos(np.clip(np.abs(along), 0.0, 1.0))

    def slip(self) -> np.ndarray:
        """Return how far the held part has slipped in the gripper, (nsim,) m; 0 if it cannot slip."""
        return np.zeros(self.nsim) if self.cell.slip is None else self.cell.qpos[:, self.cell.slip]

    def observation(self) -> dict[str, np.ndarray]:
        """Return `policy` (nsim, stack * d) and `privileged` (nsim, k), float32; see Observation for their terms."""
        truth = np.clip(np.nan_to_num(self.observed.read(self, self.observed.truth)), -LIMIT, LIMIT)
        return {POLICY: policy_part(self.seen.stack), PRIVILEGED: truth.astype(np.float32)}

    def snapshot(self, row: int) -> Snapshot:
        """Return the present state of a row, for rendering."""
        model = compiled(self.scene)  # joints that effects added come last
        qpos, qvel = self.cell.qpos[row, : model.nq].copy(), self.cell.qvel[row, : model.nv].copy()
        return Snapshot(qpos, qvel, self.bodies(row), int(self.count[row]))

    def bodies(self, row: int) -> dict[str, np.ndarray]:
        """Return the poses of a row's fixture and held part in their parent bodies: name -> (7,) m and wxyz.

        The springs on which a world hangs them are included, since a renderer's model lacks their joints.
        """
        out, own = {}, compiled(self.scene).nq
        for name in (self.scene.fixture, self.scene.held):
            body = self.cell.model.body(name).id
            pos, quat = self.cell.batch.expanded("body_pos"), self.cell.batch.expanded("body_quat")
            pos = self.cell.model.body_pos[body] if pos is None else pos[row, body]
            quat = self.cell.model.body_quat[body] if quat is None else quat[row, body]
            out[name] = sprung(self.cell.model, own, body, np.concatenate([pos, quat]), self.cell.qpos[row])
        return out
