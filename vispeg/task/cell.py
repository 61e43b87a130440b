"""The cell as a batch of plants whose rows begin anew one by one."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from vispeg.core.effect import effect
from vispeg.core.world import World
from vispeg.robots.scene import Scene
from vispeg.sim.placement import Active, activate
from vispeg.sim.plant import Plant
from vispeg.sim.restart import RowFields, merged
from vispeg.sim.state import Fields

CONSTANT = frozenset(mujoco.MjModel._setconst_inputs)  # fields that other fields are derived from
BAD = [
    int(w)
    for w in (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)
]


class Cell(Plant):
    """Cells with effects, one a row; see Plant. Contact is resolved by MuJoCo's own semi-implicit step.

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
        self.site = {n: self.model.site(n).id for n in ("hole", "peg_tip", "flange")}
        self.site_pos, self.site_mat = self.batch.bind("site_xpos"), self.batch.bind("site_xmat")
        self.sensors = self.batch.bind("sensordata")
        self.slip = self.model.joint("peg_slip").qposadr[0]
        self.qposes = np.arange(self.model.nq)[self.qadr]
        self.warned = np.zeros(self.nsim, dtype=np.int64)
        self.external = np.zeros((self.nsim, 3))  # N, pushes at the flange, world frame
        self.outer = self.batch.bind("xfrc_applied")
        self.hand = int(self.model.site_bodyid[self.site["flange"]])

    def _write(self) -> None:
        known = {a.effect.name for a in self.active}
        absent = [Active(effect(n), self._null(n)) for n in self.names if n not in known]
        self.active = sorted([*self.active, *absent], key=lambda a: (a.effect.order, a.effect.name))
        super()._write()

    def _null(self, name: str) -> dict[str, np.ndarray]:
        kind = effect(name)
        shape = self.nsim, len(kind.targets(self.robot))
        return {k: np.full(shape, p.start if p.shape else p.null) for k, p in kind.params.items()}

    def begin(self, rows: np.ndarray, worlds: Sequence[World], q: np.ndarray, weight: np.ndarray) -> None:
        """Rows (indices) begin anew at rest at q (len(rows), nj) rad, in new worlds, their drives carrying `weight`."""
        drawn = {a.effect.name: a.p for a in activate(self.robot, worlds)}
        fresh = RowFields(self.model, len(rows))
        fields = Fields(fresh, self.robot)
        for name in {w for a in self.active for w in a.effect.writes}:
            if self.batch.expanded(name) is not None:  # else a value of the row's last episode would stay
                fresh.expand(name)
        for a in self.active:
            null = {
                k: np.broadcast_to(p.start if p.shape else p.null, (len(rows),)) for k, p in a.effect.params.items()
            }
            for k, values in a.p.items():
                new = drawn.get(a.effect.name)
                values[rows] = new[k] if new is not None else null[k][:, None]
            a.effect.write(fields, {k: v[rows] for k, v in a.p.items()})
        for name, values in fresh.values.items():
            self.batch.expand(name)[rows] = values
        if CONSTANT & set(fresh.values):
            keep = {n: self.batch.expand(n).copy() for n in fresh.values if n.startswith("qpos")}
            self.batch.set_const()
            for name, values in keep.items():
                self.batch.expand(name)[:] = values
        if self.friction or "dof_frictionloss" in fields.touched:
            self.dry[rows] = self.loss[rows][:, self.vadr]
        self.armature, self.damping = self._row_field("dof_armature"), self._row_field("dof_damping")
        self.batch.reset(ids=rows, stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        self.qpos[rows] = self.model.qpos0
        self.qpos[rows[:, None], self.qposes] = q
        self.qvel[rows] = 0.0
        self.external[rows] = 0.0
        self.acc[rows] = 0.0
        self.x.q[rows], self.x.dq[rows], self.x.ddq[rows], self.x.tau[rows] = q, 0.0, 0.0, weight
        for a in self.active:
            name = a.effect.name
            self.states[name] = merged(self.states[name], a.effect.start(self.x, a.p), rows)
        self.warned[rows] = self._warnings()[rows]
        self.batch.forward(ids=rows)

    def _warnings(self) -> np.ndarray:
        return self.batch.warning[:, BAD, 1].sum(axis=1)

    def unstable(self) -> np.ndarray:
        """(nsim,) rows that MuJoCo found not finite and put back to the start since they began."""
        return self._warnings() > self.warned

    def read(self) -> None:
        """True joint motion at this instant, into `x`."""
        self.x.q = self.qpos[:, self.qadr].copy()
        self.x.dq = self.qvel[:, self.vadr].copy()
        self.x.ddq = self.acc

    def advance(self, command: np.ndarray, nsub: int) -> None:
        """`nsub` physics steps under the held command (nsim, nj) N m."""
        self.outer[:, self.hand, :3] = self.external
        if not (self.drives or self.extra or self.friction):  # nothing to be asked between the steps
            self.ctrl[:, self.u] = command
            before = self.qvel[:, self.vadr].copy()
            self.batch.step(nstep=nsub)
            self.acc = (self.qvel[:, self.vadr] - before) / (self.h * nsub)
            return
        for sub in range(nsub):
            if sub:
                self.read()
            self._substep(command)

    def _substep(self, command: np.ndarray) -> None:
        tau = command
        for a in self.drives:
            tau = a.effect.drive(self.states[a.effect.name], tau, self.x, a.p)
        if self.friction:
            level = self.dry.copy()
            for a in self.friction:
                level += a.effect.friction(self.states[a.effect.name], self.x, a.p)
            self.loss[:, self.vadr] = level
        self.ctrl[:, self.u] = tau
        if self.extra:
            parts = [a.effect.torque(self.states[a.effect.name], self.x, a.p) for a in self.extra]
            self.applied[:, self.vadr] = np.sum(parts, axis=0)
        before = self.qvel[:, self.vadr].copy()
        self.batch.step()
        self.acc = (self.qvel[:, self.vadr] - before) / self.h
        self.x.tau = tau

    def site_position(self, name: str) -> np.ndarray:
        """World position (nsim, 3) m of `hole`, `peg_tip` or `flange`."""
        return self.site_pos[:, self.site[name]]

    def site_rotation(self, name: str) -> np.ndarray:
        """World rotation (nsim, 3, 3) of a site."""
        return self.site_mat[:, self.site[name]].reshape(self.nsim, 3, 3)
