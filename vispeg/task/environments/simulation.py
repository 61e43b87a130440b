"""A task on a batch of cells: start rows, move them by actions, say what each policy may see."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from vispeg.control.laws import rotated, rotation_vector, turned
from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.render.image_kinds import GOAL_TOLD, MODES
from vispeg.render.snapshot import Snapshot
from vispeg.sim.compiled import compiled, nominal_of
from vispeg.sim.quiet import quiet
from vispeg.sim.reach import reach
from vispeg.task.cell import Cell
from vispeg.task.config import DOF, TaskConfig
from vispeg.task.control import PoseControl
from vispeg.task.guards import Guards
from vispeg.task.registry import task_of
from vispeg.task.result import EpisodeResult
from vispeg.task.rewards import Moment
from vispeg.task.start import ABOVE, DOWN, home
from vispeg.task.terms import LIMIT, POLICY, PRIVILEGED, Observation, Stack
from vispeg.worlds.randomized import RandomizedWorld
from vispeg.worlds.split import physical
from vispeg.worlds.world import World


class TaskSimulation:
    """nsim independent episodes of the task; rows end and begin one by one.

    Args:
        world: what episodes draw or share; its robot is the cell of `config`. Looks and sensors are left to whoever
            draws pictures.
        config: the task.
        nsim: rows.
        obs_mode: decides which target the policy's part of the observation is relative to.
        nthread: threads of the physics.
    """

    def __init__(
        self, world: World | RandomizedWorld, config: TaskConfig, nsim: int, obs_mode: str = "state", nthread: int = 1
    ):
        cameras = config.cameras if MODES[obs_mode] else ()
        self.world, self.nsim, self.obs_mode = physical(RandomizedWorld.of(world)), nsim, obs_mode
        self.config: Any = config  # of the task's own class
        self.task = task_of(config)
        self.scene = self.task.cell(config, cameras)
        self.observed, self.reward = Observation(self.task.terms, config), config.rewards.of(config.reward)
        self.levels: Mapping[str, float] | float = 1.0
        self.radius = config.start_radius
        h = config.control_period / config.substeps
        names = {e.effect for e in self.world.entries}
        self.drawn = [self.world.sample(0, self.scene)] * nsim  # of each row's present episode
        self.cell = Cell(self.scene, self.drawn, h, config.control_period, nthread, sorted(names))
        posture = home(self.scene)
        self.control = PoseControl(self.scene.nominal, nsim, config, posture, nthread)
        self.guards = Guards(config, self.scene, nsim)
        self.solo = nominal_of(self.scene.nominal, 1)
        self.move = np.array([d in config.dof for d in DOF])
        self.places = [DOF.index(d) for d in config.dof]  # of an action's entries among all directions
        self.nominal_goal = np.array(self.scene.target)
        tip = self.nominal_goal + [0, 0, ABOVE + self.scene.tip]
        rest = np.tile(tip, (nsim, 1)), np.tile(DOWN, (nsim, 1))
        self.home = reach(self.control.nominal, *rest, np.tile(posture, (nsim, 1)))[0]
        self.control.home = self.home[0]
        weight = self.control.nominal.gravity(self.home).copy()
        mass = self.control.nominal.operational(self.home)[0]
        apparent = 1.0 / np.diagonal(np.linalg.inv(mass), axis1=1, axis2=2)
        self.cell.start(self.home, np.zeros_like(self.home), weight, apparent)
        self.tare = self._tool_weight()
        n = nsim
        self.straight = np.tile(DOWN, (n, 1))
        self.goal, self.rot = np.zeros((n, 3)), self.straight.copy()  # flange pose that is commanded
        self.held = self.goal.copy()  # where that puts the end of `lever`
        self.believed, self.seeds = np.zeros((n, 3)), np.zeros(n, dtype=np.int64)
        self.action, self.count = np.zeros((n, len(config.dof))), np.zeros(n, dtype=int)
        self.wrench, self.tracks = np.zeros((n, 6)), [self.task.track() for _ in range(n)]
        self.stack = Stack(config.stack, n, self.observed.policy_size)
        self.diverged = np.zeros(n, dtype=bool)
        self.measured = self.home.copy(), np.zeros_like(self.home)
        self.push: list[Any] = [None] * n
        self.acted: list[list[np.ndarray]] = [[] for _ in range(n)]  # actions of the present episodes
        self.heard: Callable[..., None] | None = None  # called at each control tick with q, dq, and the wrench after it

    def _tool_weight(self) -> np.ndarray:
        """Weight (3,) N in the world frame that the wrench sensor carries at rest, as the controller knows it."""
        model = self.scene.nominal.compile()
        tool = [b for b in range(model.nbody) if model.body(b).name in ("tool", self.scene.held)]
        return float(model.body_mass[tool].sum()) * model.opt.gravity

    # Episodes -------------------------------------------------------------------------------------------------
    def reset(self, rows: np.ndarray, seeds: Sequence[int]) -> None:
        """Rows (indices) begin the episodes of these seeds."""
        if not len(rows):
            return
        pos = np.tile(self.nominal_goal + [0, 0, 0.1], (self.nsim, 1))
        worlds = []
        for row, seed in zip(rows, seeds, strict=True):
            rng = stream(int(seed), "start")
            pos[row] = self.nominal_goal + self.task.start(self.config, self.radius, rng)
            worlds.append(self.world.sample(int(seed), self.scene, self.levels))
            self.drawn[row], self.seeds[row] = worlds[-1], seed
            self.tracks[row], self.push[row], self.acted[row] = self.task.track(), None, []
        self.guards.reset(rows)
        pos[:, 2] += self.scene.tip
        q, weight = self._start(rows, pos)
        self.cell.begin(rows, worlds, q, weight)
        self.goal[rows], self.rot[rows] = pos[rows], DOWN
        self.held[rows] = (self.goal + self.lever(self.rot))[rows]
        self.action[rows], self.count[rows], self.wrench[rows], self.diverged[rows] = 0.0, 0, 0.0, False
        self._believe(rows)
        self.cell.read()
        begun = np.isin(np.arange(self.nsim), rows)[:, None]  # the others go on with what they last measured
        true = self.cell.x.q, self.cell.x.dq
        q, dq = (np.where(begun, new, old) for new, old in zip(true, self.measured, strict=True))
        self.see(q, dq)
        self.stack.fill(rows, self.observed.read(self, self.observed.policy))

    def _start(self, rows: np.ndarray, pos: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Joint angles (len(rows), nj) in rad that put these rows' flanges at `pos`, and the weight there, N m."""
        few = 4 * len(rows) < self.nsim  # then arms one by one cost less than all of them; the answer is the same
        q, weight = self.home.copy(), np.zeros_like(self.home)
        for some in rows[:, None] if few else [np.arange(self.nsim)]:
            nominal = self.solo if few else self.control.nominal
            q[some], error = reach(nominal, pos[some], np.tile(DOWN, (len(some), 1)), q[some])
            low, high = self.scene.range.T
            error = np.where(((q[some] < low) | (q[some] > high)).any(axis=1), np.inf, error)
            asked = np.isin(some, rows)
            if error[asked].max() > 1e-4:
                place = pos[some[asked][int(error[asked].argmax())]]
                raise UserError("the start is out of the arm's reach", got=place.round(3))
            weight[some] = nominal.gravity(q[some])
        return q[rows], weight[rows]

    def see(self, q: np.ndarray, dq: np.ndarray) -> None:
        """The measured motion, and the flange's pose and twist that follow from it."""
        self.measured = q, dq
        self.flange, self.turn, self.twist, self.jac = self.control.pose(q, dq)

    def lever(self, rot: np.ndarray) -> np.ndarray:
        """From the flange to the point that actions move and turn about, (nsim, 3) m: the tip of a tool held straight
        where the policy turns it, else the flange itself. A turn about the flange would throw the tip aside."""
        return rotated(rot, np.array([0.0, 0.0, self.scene.tip])) if self.config.turns else np.zeros((self.nsim, 3))

    def _believe(self, rows: np.ndarray) -> None:
        if self.obs_mode not in GOAL_TOLD:
            self.believed[rows] = self.nominal_goal
            return
        goal = self.cell.site_position("goal")
        for a in self.cell.active:
            if a.effect.overrides("believe"):
                goal = a.effect.believe(goal, a.p)
        self.believed[rows] = goal[rows]

    def offset_by(self, action: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where an action (nsim, 6), an offset from where the arm is, puts the held point and the flange's turn.

        Directions that the policy does not move are held.
        """
        c = self.config
        moved = self.flange + self.lever(self.turn) + c.offset * action[:, :3]
        held, rot = np.where(self.move[:3], moved, self.held), self.rot
        if c.turns:
            asked = rotation_vector(self.straight, self.turn) + c.turn * action[:, 3:]
            rot = turned(self.straight, np.where(self.move[3:], asked, 0.0))
        return held, rot

    def step(self, action: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[EpisodeResult | None]]:
        """One policy step of every row.

        Args:
            action: (nsim, len(dof)) in [-1, 1].

        Returns:
            reward (nsim,), terminated and truncated (nsim,) bool, and for every row that ended its episode's record.
        """
        c, cell = self.config, self.cell
        self.action = np.clip(np.nan_to_num(np.asarray(action, float)), -1.0, 1.0)
        for acted, executed in zip(self.acted, self.action, strict=True):
            acted.append(executed)
        motion = np.zeros((self.nsim, 6))
        motion[:, self.places] = self.action
        self.held, self.rot = self.task.command(self, motion)
        self.goal = self.held - self.lever(self.rot)
        force, wrenches = np.empty((c.ticks, self.nsim, 3)), np.empty((c.ticks, self.nsim, 6))
        with quiet(), np.errstate(all="ignore"):
            for k in range(c.ticks):
                cell.read()
                if self.guards.on:
                    self.guards.tick(cell.x.q, cell.x.dq)
                q, dq = cell.measure()
                if any(p is not None for p in self.push):
                    self._pushes(k)
                cell.advance(self.control.torque(q, dq, self.goal, self.rot), c.substeps)
                wrenches[k], force[k] = cell.felt(), cell.sensors[:, 7:10]
                if self.heard is not None:
                    self.heard(q, dq, wrenches[k])
            forces = np.linalg.norm(force, axis=2)
            cell.read()
            self.see(*cell.measure())
            self.guards.pose(self.jac)
            return self._settle(forces, wrenches)

    def _pushes(self, k: int) -> None:
        for row, push in enumerate(self.push):
            if push is not None:
                t = (self.count[row] * self.config.ticks + k) * self.config.control_period
                self.cell.external[row] = push.force if push.start <= t < push.start + push.duration else 0.0

    def _settle(self, forces, wrenches):
        c, cell = self.config, self.cell
        self.count += 1
        tip = self.tip_in_goal()
        bad = ~np.isfinite(cell.qpos).all(axis=1) | ~np.isfinite(forces).all(axis=0) | (np.abs(tip).max(axis=1) > 2.0)
        bad |= ~np.isfinite(tip).all(axis=1) | cell.unstable()
        self.diverged |= bad
        forces = np.where(bad, 0.0, forces)
        tip = np.where(bad[:, None], 0.5, tip)
        recent = np.nan_to_num(wrenches[-4:].mean(axis=0))
        site = cell.site_rotation("flange")
        self.wrench[:, :3] = np.einsum("nij,nj->ni", site, recent[:, :3]) - self.tare
        self.wrench[:, 3:] = np.einsum("nij,nj->ni", site, recent[:, 3:])
        goal = self.task.goal(c)
        gain = self.reward.dense(Moment(tip, goal, forces.max(axis=0), self.action, c.reward_scale, self))
        observed = {name: np.nan_to_num(value) for name, value in self.task.observed(self).items()}
        terminated, truncated = np.zeros(self.nsim, dtype=bool), self.count >= c.steps
        records: list[EpisodeResult | None] = [None] * self.nsim
        for i, track in enumerate(self.tracks):
            track.add(c, forces[:, i], tip[i], **{name: float(value[i]) for name, value in observed.items()})
            category = "diverged" if self.diverged[i] else self.guards.stopped[i] or track.verdict(c)
            terminated[i] = category is not None
            if category is not None:
                gain[i] += self.reward.success if category == "success" else self.reward.abort
            elif truncated[i]:
                category = track.at_time(c)
            if category is not None:
                records[i] = self._record(i, category)
        terms = self.observed.read(self, self.observed.policy)
        self.stack.push(np.nan_to_num(terms, posinf=0.0, neginf=0.0))
        return gain, terminated, truncated & ~terminated, records

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
            "force_profile": tuple(
                np.concatenate(t.forces).tolist()
            ),  # not an array: gymnasium stacks these, of one length
            "world": self.drawn[i].values,
        }

    # What can be seen -----------------------------------------------------------------------------------------
    def tip_in_goal(self) -> np.ndarray:
        """True tip (nsim, 3) m in the goal's frame; z is negative below its plane."""
        offset = self.cell.site_position("tip") - self.cell.site_position("goal")
        return np.einsum("nji,nj->ni", self.cell.site_rotation("goal"), offset)

    def tilt(self) -> np.ndarray:
        """Angle (nsim,) rad between the tip's axis and the goal's."""
        along = np.einsum("nj,nj->n", self.cell.site_rotation("tip")[:, :, 2], self.cell.site_rotation("goal")[:, :, 2])
        return np.arccos(np.clip(np.abs(along), 0.0, 1.0))

    def slip(self) -> np.ndarray:
        """How far (nsim,) m the held part slipped in the gripper; 0 where it cannot."""
        return np.zeros(self.nsim) if self.cell.slip is None else self.cell.qpos[:, self.cell.slip]

    def observation(self) -> dict[str, np.ndarray]:
        """`policy` (nsim, stack d) and `privileged` (nsim, k), float32; see Observation for what they hold."""
        truth = np.nan_to_num(self.observed.read(self, self.observed.truth))
        parts = {POLICY: self.stack.flat(), PRIVILEGED: truth}
        return {key: np.clip(value, -LIMIT, LIMIT).astype(np.float32) for key, value in parts.items()}

    def snapshot(self, row: int) -> Snapshot:
        """How this row stands now, for whoever draws it."""
        qpos = self.cell.qpos[row, : compiled(self.scene).nq].copy()  # springs that effects built in come last
        flange = self.cell.site_position("flange")[row].copy()
        return Snapshot(qpos, self.bodies(row), self.twist[row].copy(), flange, int(self.count[row]))

    def bodies(self, row: int) -> dict[str, np.ndarray]:
        """Where this row's fixture and held part are placed in their parents, (7,) each, for whoever draws them."""
        out = {}
        for name in (self.scene.fixture, self.scene.held):
            body = self.cell.model.body(name).id
            pos, quat = self.cell.batch.expanded("body_pos"), self.cell.batch.expanded("body_quat")
            pos = self.cell.model.body_pos[body] if pos is None else pos[row, body]
            quat = self.cell.model.body_quat[body] if quat is None else quat[row, body]
            out[name] = np.concatenate([pos, quat])
        return out
