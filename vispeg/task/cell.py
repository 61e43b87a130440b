"""The cell as a batch of plants whose rows begin anew one by one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from vispeg.core.effect import effect
from vispeg.recordings.cell import reaction
from vispeg.robots.scene import Scene
from vispeg.sim.physics import derive, exact, firm, total
from vispeg.sim.placement import Active, activate
from vispeg.sim.plant import Plant
from vispeg.sim.state import Fields
from vispeg.worlds.world import World

CONSTANT = frozenset(mujoco.MjModel._setconst_inputs)  # fields that other fields are derived from
BAD = [
    int(w)
    for w in (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)
]


class Cell(Plant):
    """Cells with effects, one a row; see Plant. Contact is resolved by MuJoCo's own semi-implicit step.

    That step's positions are second order where its velocity is read as that of the half step and a command is taken
    to begin in the middle of its first step. Plant also makes forces of velocity second order, at twice the cost of a
    step; here friction, damping and Coriolis terms are half a step late.

    Args:
        scene: the nominal cell.
        worlds: one a row, already drawn.
        h, tick, nthread: physics step (s), control period (s), threads.
        names: effects that any row may ever have, so that a row that begins anew can have them.
    """

    def __init__(
        self, scene: Scene, worlds: Sequence[World], h: float, tick: float, nthread: int, names: Sequence[str]
    ):
        self.names = sorted(names, key=lambda n: (effect(n).order, n))
        super().__init__(scene, worlds, h, tick, nthread)
        names_of = {"goal": scene.goal, "tip": scene.tip_site, "flange": "flange"}
        self.site = {name: self.model.site(site).id for name, site in names_of.items()}
        self.site_pos, self.site_mat = self.batch.bind("site_xpos"), self.batch.bind("site_xmat")
        self.sensors = self.batch.bind("sensordata")
        self.filtered, self.mean = False, np.zeros_like(self.sensors)
        self._held_by = scene.slip  # the joint along which the held part may slip
        self.slip = self.model.joint(scene.slip).qposadr[0] if scene.slip else None
        self.qposes = np.arange(self.model.nq)[self.qadr]
        self.dofs = np.arange(self.model.nv)[self.vadr]
        self.bodies = self.model.dof_bodyid[self.dofs]
        self.warned = np.zeros(self.nsim, dtype=np.int64)
        self.external = np.zeros((self.nsim, 3))  # N, pushes at the flange, world frame
        self.beside: np.ndarray | None = None  # (nsim, nj) N m, on the links beside all effects; None: never any
        self.outer = self.batch.bind("xfrc_applied")
        self.hand = int(self.model.site_bodyid[self.site["flange"]])

    def _active(self, worlds: Sequence[World]) -> list[Active]:
        active = super()._active(worlds)
        placed = {a.effect.name for a in active}
        absent = [Active(effect(n), self._null(n)) for n in self.names if n not in placed]
        return sorted([*active, *absent], key=lambda a: (a.effect.order, a.effect.name))

    def _null(self, name: str) -> dict[str, np.ndarray]:
        kind = effect(name)
        return kind.absent((self.nsim, len(kind.targets(self.robot))))

    def begin(self, rows: np.ndarray, worlds: Sequence[World], q: np.ndarray, weight: np.ndarray) -> None:
        """Rows (indices) begin anew at rest at q (len(rows), nj) rad, in new worlds, their drives carrying `weight`."""
        drawn = {a.effect.name: a.p for a in activate(self.robot, worlds)}
        fresh = RowFields(self.model, len(rows))
        fields = Fields(fresh, self.robot)
        # dry friction is also set step by step, by effects that do not write it
        for name in {w for a in self.active for w in a.effect.writes} | {"dof_frictionloss"}:
            if self.batch.expanded(name) is not None:  # else a value of the row's last episode would stay
                fresh.expand(name)
        for a in self.active:
            new = drawn.get(a.effect.name)
            for k, values in a.p.items():
                values[rows] = new[k] if new is not None else a.effect.params[k].absent
            a.effect.write(fields, {k: v[rows] for k, v in a.p.items()})
        for name, values in fresh.values.items():
            self.batch.expand(name)[rows] = values
        if CONSTANT & set(fresh.values):
            derive(self.batch, fields)
            if self.filtered:
                self._firm()
        if self.dry is not None:
            self.dry[rows] = self.loss[rows][:, self.vadr]
        self.armature, self.damping = self._row_field("dof_armature"), self._row_field("dof_damping")
        self.batch.reset(ids=rows, stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        self.qpos[rows] = self.model.qpos0
        self.qpos[rows[:, None], self.qposes] = q
        self.qvel[rows] = 0.0
        self.external[rows] = 0.0
        if self.beside is not None:
            self.beside[rows] = 0.0
        self.acc[rows] = 0.0
        self.x.q[rows], self.x.dq[rows], self.x.ddq[rows], self.x.tau[rows] = q, 0.0, 0.0, weight
        self.last[rows] = weight
        self.loop.restart(self.x, rows)
        self.warned[rows] = self._warnings()[rows]
        self.batch.forward(ids=rows)

    def _warnings(self) -> np.ndarray:
        return self.batch.warning[:, BAD, 1].sum(axis=1)

    def unstable(self) -> np.ndarray:
        """(nsim,) rows that MuJoCo found not finite and put back to the start since they began."""
        return self._warnings() > self.warned

    def start(self, q: np.ndarray, dq: np.ndarray, weight: np.ndarray, inertia: np.ndarray) -> None:
        """See Plant.start; a drive carries `weight` before its first command."""
        self.last = weight.copy()
        self.wrench, self.axis = self.batch.bind("cfrc_int"), self.batch.bind("cdof")
        self.spring = self.batch.bind("qfrc_spring")
        super().start(q, dq, weight, inertia)

    def recorded(self) -> None:
        """From now on contacts are found exactly, a held part does not creep, and sensors filter: contact chatters in
        step with the controller, so that a reading at a tick's end alone is a biased sample.
        """
        exact(self.batch)
        self._firm()
        self.filtered = True

    def _firm(self) -> None:
        if self._held_by:
            firm(self.batch, self.model, self._held_by)

    def felt(self) -> np.ndarray:
        """Give what the wrist's force sensor says of the last step, or of the mean of the last tick where it is
        `filtered`: (nsim, 6) N and N m that the tool puts on the flange, in the flange's frame. To be asked once a
        control tick.
        """
        return self.loop.feel(reaction(self.read_out[:, :6]), self.x)

    @property
    def read_out(self) -> np.ndarray:
        """(nsim, k) sensors of the last step; where they are `filtered`, their mean over the steps of the last tick."""
        return self.mean if self.filtered else self.sensors

    def gear_torque(self) -> np.ndarray:
        """Torque (nsim, nj) N m that the gears handed to the links in the last step."""
        return self.x.tau if self.loop.acts else self._geared(self.beside)

    def advance(self, command: np.ndarray, nsub: int) -> None:
        """`nsub` physics steps under the held command (nsim, nj) N m."""
        if not self.filtered:
            return self._advance(command, nsub)
        self.mean = np.zeros_like(self.sensors)
        for step in range(nsub):
            if step:
                self.read()
            self._advance(command, 1)
            self.mean += self.sensors / nsub
        return None

    def _advance(self, command: np.ndarray, nsub: int) -> None:
        self.outer[:, self.hand, :3] = self.external
        if self.beside is not None:
            self.applied[:, self.vadr] = self.beside
        if not self.loop.acts:  # nothing to be asked between the steps
            self._move(command)
            if nsub > 1:
                self._move(command, nsub - 1)
            return
        if self.loop.foreseen:  # the motion between the steps changes nothing
            for _ in range(nsub):
                self._move(self.forces(command).drive)
            self.x.tau = self._geared(self.beside)
            return
        for sub in range(nsub):
            if sub:
                self.read()
            forces = self.forces(command)
            applied = total(forces.beside, self.beside)
            if applied is not None:
                self.applied[:, self.vadr] = applied
            self._move(forces.drive)
            self.x.tau = self._geared(total(forces.link, self.beside))

    def _move(self, tau: np.ndarray, nstep: int = 1) -> None:
        """Step under the torque `tau` (nsim, nj) N m; the first kick spans half of the last step, half of this one."""
        self.ctrl[:, self.u] = 0.5 * (tau + self.last)
        self.last = tau
        before = self.qvel[:, self.vadr].copy()
        self.batch.step(nstep=nstep)
        self.acc = (self.qvel[:, self.vadr] - before) / (self.h * nstep)

    def _geared(self, link: np.ndarray | None) -> np.ndarray:
        """Torque (nsim, nj) N m that the gears handed to the links: what goes through the joints less what acts beside.

        The wrench between neighbouring links along the joint's axis, MuJoCo's `cfrc_int`, is what Plant sums up from
        the drive's parts; here contact forces are among the constraint forces, and do not pass through the gear alone.
        """
        through = np.einsum("njk,njk->nj", self.axis[:, self.dofs], self.wrench[:, self.bodies])
        through -= self.spring[:, self.vadr]
        return through if link is None else through - link

    def site_position(self, name: str) -> np.ndarray:
        """World position (nsim, 3) m of `goal`, `tip` or `flange`."""
        return self.site_pos[:, self.site[name]]

    def site_rotation(self, name: str) -> np.ndarray:
        """World rotation (nsim, 3, 3) of a site."""
        return self.site_mat[:, self.site[name]].reshape(self.nsim, 3, 3)


class RowFields:
    """Stands in for a batch while effects write a few rows: `expand(name)` is (nrow, ...), nominal until written."""

    def __init__(self, model: Any, nrow: int):
        self.model, self.nrow = model, nrow
        self.values: dict[str, np.ndarray] = {}

    def expand(self, name: str) -> np.ndarray:
        """Give a writable copy of the model's field, one a row."""
        if name not in self.values:
            owner = self.model.opt if name.startswith("opt.") else self.model
            value = np.asarray(getattr(owner, name.removeprefix("opt.")))
            self.values[name] = np.repeat(value[None], self.nrow, axis=0)
        return self.values[name]
