"""The cell as a batch of simulated plants, one per row, each of which can start a new episode on its own."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from vispeg.core.effect import effect
from vispeg.recordings.cell import reaction
from vispeg.robots.scene import Scene
from vispeg.sim.physics import derive, exact, firm, total
from vispeg.sim.placement import Active, activate
from vispeg.sim.plant import Plant
from vispeg.sim.state import Fields, RowFields
from vispeg.worlds.world import World

CONSTANT = frozenset(mujoco.MjModel._setconst_inputs)  # fields from which MuJoCo derives other fields
BAD = [  # warnings with which MuJoCo resets a state that diverged
    int(w)
    for w in (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)
]


class Cell(Plant):
    """Cells with effects, one per row; see Plant. Contact is resolved by MuJoCo's own semi-implicit step.

    Positions of that step are second order if its velocity is read as that of the half step and a command is taken to
    begin in the middle of its first step. Forces that depend on velocity (friction, damping, Coriolis) lag by half a
    step here. Plant computes these, too, to second order, at twice the cost of a step.

    Args:
        scene: the nominal cell.
        worlds: one per row, already drawn.
        h, tick, nthread: physics step (s), control period (s), threads.
        names: effects that a row may have in any of its episodes.
        engine: of the physics, see `vispeg.sim.engine`.
    """

    def __init__(
        self,
        scene: Scene,
        worlds: Sequence[World],
        h: float,
        tick: float,
        nthread: int,
        names: Sequence[str],
        engine: str = "c",
    ):
        self.names = sorted(names, key=lambda n: (effect(n).order, n))
        super().__init__(scene, worlds, h, tick, nthread, engine=engine)
        names_of = {"goal": scene.goal, "tip": scene.tip_site, "flange": "flange"}
        self.site = {name: self.model.site(site).id for name, site in names_of.items()}
        self.site_pos, self.site_mat = self.batch.bind("site_xpos"), self.batch.bind("site_xmat")
        self.sensors = self.batch.bind("sensordata")
        self.filtered, self.mean = False, np.zeros_like(self.sensors)
        self._slip_joint = scene.slip  # joint along which the held part may slip; "" if it cannot
        self.slip = self.model.joint(scene.slip).qposadr[0] if scene.slip else None  # its index in qpos
        self.qposes = np.arange(self.model.nq)[self.qadr]
        self.dofs = np.arange(self.model.nv)[self.vadr]
        self.bodies = self.model.dof_bodyid[self.dofs]
        self.warned = np.zeros(self.nsim, dtype=np.int64)
        self.external = np.zeros((self.nsim, 3))  # N, pushes at the flange, world frame
        self.beside: np.ndarray | None = None  # (nsim, nj) N m, on the links, not from effects; None until first used
        self.outer = self.batch.bind("xfrc_applied")
        self.hand = int(self.model.site_bodyid[self.site["flange"]])

    def _active(self, worlds: Sequence[World]) -> list[Active]:
        """Return the effects of the worlds, and those of `names` that no world has yet, with absent parameters."""
        active = super()._active(worlds)
        placed = {a.effect.name for a in active}
        absent = [Active(effect(n), self._null(n)) for n in self.names if n not in placed]
        return sorted([*active, *absent], key=lambda a: (a.effect.order, a.effect.name))

    def _null(self, name: str) -> dict[str, np.ndarray]:
        kind = effect(name)
        return kind.absent((self.nsim, len(kind.targets(self.robot))))

    def begin(self, rows: np.ndarray, worlds: Sequence[World], q: np.ndarray, weight: np.ndarray) -> None:
        """Start rows anew at rest, in new worlds.

        Args:
            rows: their indices.
            worlds: one for each of them, already drawn.
            q: (len(rows), nj) joint angles, rad.
            weight: (len(rows), nj) N m, torque of the drives before their first command.
        """
        drawn = {a.effect.name: a.p for a in activate(self.robot, worlds)}
        fresh = RowFields(self.model, len(rows))
        fields = Fields(fresh, self.robot)
        # some effects set dry friction in every step, although `writes` does not list it
        for name in {w for a in self.active for w in a.effect.writes} | {"dof_frictionloss"}:
            if self.batch.expanded(name) is not None:  # else the value of the row's last episode would remain
                fresh.expand(name)
        for a in self.active:
            new = drawn.get(a.effect.name)
            for k, values in a.p.items():
                values[rows] = new[k] if new is not None else a.effect.params[k].absent
            a.effect.write(fields, {k: v[rows] for k, v in a.p.items()})
        for name, values in fresh.values.items():
            self.batch.expand(name)[rows] = values
        if CONSTANT & set(fresh.values):
            fields.touched |= set(fresh.values)  # what no effect writes now may have been written for the last episode
            derive(self.batch, fields, rows)
            if self.filtered:
                self._firm(rows)
        if self.dry is not None:
            self.dry[rows] = self._row_field("dof_frictionloss")[rows]
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
        self.x.t[rows] = 0.0
        self.loop.restart(self.x, rows)
        self.warned[rows] = self._warnings()[rows]
        self.batch.forward(ids=rows)

    def _warnings(self) -> np.ndarray:
        return self.batch.warning[:, BAD, 1].sum(axis=1)

    def unstable(self) -> np.ndarray:
        """Return the rows (nsim,) bool that MuJoCo has reset since their episode began, for values that diverged."""
        return self._warnings() > self.warned

    def start(
        self, q: np.ndarray, dq: np.ndarray, weight: np.ndarray, inertia: np.ndarray, begun: np.ndarray | float = 0.0
    ) -> None:
        """Start all rows, see Plant.start; `weight` is the torque of the drives before their first command."""
        self.last = weight.copy()
        self.wrench, self.axis = self.batch.bind("cfrc_int"), self.batch.bind("cdof")
        self.spring = self.batch.bind("qfrc_spring")
        super().start(q, dq, weight, inertia, begun)

    def use_recording_settings(self) -> None:
        """Switch to the settings for recordings: exact contacts, no creep of a held part, and filtered sensors.

        A filtered reading is the mean over the steps of a control tick. Contact chatters in step with the controller,
        so that a reading of a tick's last step alone would be biased.
        """
        exact(self.batch)
        self._firm()
        self.filtered = True

    def _firm(self, rows: np.ndarray | slice = slice(None)) -> None:
        if self._slip_joint:
            firm(self.batch, self.model, self._slip_joint, rows)

    def felt(self) -> np.ndarray:
        """Return the wrist sensor's reading: the wrench of the tool on the flange, flange frame, (nsim, 6) N and N m.

        It is that of the last step or, if `filtered`, the mean over the last tick. Call it once per control tick.
        """
        return self.loop.feel(reaction(self.read_out[:, :6]), self.x)

    @property
    def read_out(self) -> np.ndarray:
        """Sensor values (nsim, 10) of the last step or, if `filtered`, their mean over the steps of the last tick.

        Columns 0:6 are the wrist's force (N) and torque (N m) in the flange frame, column 6 is whether there is
        contact, columns 7:10 are the net contact force (N) in the world frame.
        """
        return self.mean if self.filtered else self.sensors

    def gear_torque(self) -> np.ndarray:
        """Return the torque (nsim, nj) N m that the gears transmitted to the links in the last step."""
        stored = self.loop.acts and not self.loop.foreseen  # by `_advance`, after each step
        return self.x.tau if stored else self._geared(self.beside)

    def advance(self, command: np.ndarray, nsub: int) -> None:
        """Simulate `nsub` physics steps under the held command (nsim, nj) N m."""
        if not self.filtered:
            return self._advance(command, nsub)
        self.mean = np.zeros_like(self.sensors)
        for step in range(nsub):
            if step:  # before the first step, the caller has read the state
                self.read()
            self._advance(command, 1)
            self.mean += self.sensors / nsub
        return None

    def _advance(self, command: np.ndarray, nsub: int) -> None:
        self.outer[:, self.hand, :3] = self.external
        if self.beside is not None:
            self.applied[:, self.vadr] = self.beside
        if not self.loop.acts:  # no effect has to be evaluated in each step
            self._move(command)
            if nsub > 1:
                self._move(command, nsub - 1)
            return
        if self.loop.foreseen:  # the effects depend on the command alone, not on the motion within the tick
            for _ in range(nsub):
                self._move(self.loop.drive(command, self.x)[0])
            return
        for sub in range(nsub):
            if sub:
                self.read()
            forces = self.forces(command)
            applied = total(forces.other, self.beside)
            if applied is not None:
                self.applied[:, self.vadr] = applied
            self._move(forces.drive)
            self.x.tau = self._geared(total(forces.link, self.beside))

    def _move(self, tau: np.ndarray, nstep: int = 1) -> None:
        """Simulate `nstep` steps under the torque `tau` (nsim, nj) N m.

        The first velocity update spans half of the previous step and half of this one, so it uses the mean torque.
        """
        self.ctrl[:, self.u] = 0.5 * (tau + self.last)
        self.last = tau
        before = self.qvel[:, self.vadr].copy()
        self.batch.step(nstep=nstep)
        self.acc = (self.qvel[:, self.vadr] - before) / (self.h * nstep)
        self.x.t = self.x.t + self.h * nstep

    def _geared(self, link: np.ndarray | None) -> np.ndarray:
        """Return the torque (nsim, nj) N m that the gears transmitted to the links.

        It is the wrench between neighbouring links (MuJoCo's `cfrc_int`) along the joint's axis, less the joint's
        spring and less the torque `link` (nsim, nj) N m that acts on the link past the gear. Plant sums up the parts
        of the drive instead; that fails here, where the constraint forces include contact.
        """
        through = np.einsum("njk,njk->nj", self.axis[:, self.dofs], self.wrench[:, self.bodies])
        through -= self.spring[:, self.vadr]
        return through if link is None else through - link

    def site_position(self, name: str) -> np.ndarray:
        """Return the world position (nsim, 3) m of the site `goal`, `tip` or `flange`."""
        return self.site_pos[:, self.site[name]]

    def site_rotation(self, name: str) -> np.ndarray:
        """Return the rotation (nsim, 3, 3) from the axes of the site `goal`, `tip` or `flange` to the world's."""
        return self.site_mat[:, self.site[name]].reshape(self.nsim, 3, 3)
