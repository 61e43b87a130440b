"""Simulate worlds side by side in the cell, in closed loop under a recorded controller, and read their sensors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vispeg.recordings.cell import reaction
from vispeg.recordings.recording import Control
from vispeg.robots.scene import Scene
from vispeg.sim.compiled import nominal_of
from vispeg.sim.controller import Controller
from vispeg.sim.quiet import quiet
from vispeg.sim.rollout import ReadingNoise
from vispeg.sim.segments.rows import Rows
from vispeg.sim.segments.segment import Segment
from vispeg.task.cell import Cell
from vispeg.worlds.split import physical
from vispeg.worlds.world import World

STEP = 5e-4  # s, greatest physics step: contact is stiff


@dataclass(frozen=True)
class Ran:
    """Sensor readings of the simulated cells at the control ticks; leading axes (nworld, n).

    Attributes:
        q, dq, tau: (.., nj) encoder angle (rad), encoder velocity (rad/s), torque on the link's side of the gear (N m).
        ft: (.., 6) N and N m, wrench of the flange on the tool, in the flange's frame.
        tip: (.., 3) m, true position of the tip in the true goal's frame.
        touch: (..,) N, norm of the true contact force's mean over the steps of the tick that ends at the sample.
        true: (.., nj) rad, true joint angles, which only an external camera could see; NaN if not recorded.
        diverged: (nworld,) bool.
    """

    q: np.ndarray
    dq: np.ndarray
    tau: np.ndarray
    ft: np.ndarray
    tip: np.ndarray
    touch: np.ndarray
    true: np.ndarray
    diverged: np.ndarray


class Reader:
    """Collects the sensor readings of a cell tick by tick; row k holds the readings before the command of tick k."""

    def __init__(self, ticks: int, nsim: int, nj: int):
        self.q, self.dq, self.tau = (np.zeros((ticks, nsim, nj)) for _ in range(3))
        self.true = np.full((ticks, nsim, nj), np.nan)
        self.ft, self.tip, self.touch = np.zeros((ticks, nsim, 6)), np.zeros((ticks, nsim, 3)), np.zeros((ticks, nsim))

    def tick(self, k: int, cell: Cell, q: np.ndarray, dq: np.ndarray, felt: np.ndarray) -> None:
        """Store readings after the steps of tick k.

        Args:
            k: the tick.
            cell: in its state at the end of the tick; torque, contact force and tip become row k + 1.
            q, dq: (nsim, nj) encoder readings at the tick's begin, row k, rad and rad/s.
            felt: (nsim, 6) wrist reading at the end of the tick (wrench of the tool on the flange), row k + 1.
        """
        self.q[k], self.dq[k] = q, dq
        offset = cell.site_position("tip") - cell.site_position("goal")
        tip = np.einsum("nji,nj->ni", cell.site_rotation("goal"), offset)
        touch, tau = np.linalg.norm(cell.read_out[:, 7:10], axis=1), cell.gear_torque()
        rows = [0, 1] if k == 0 else [k + 1]  # no step precedes row 0, so it repeats row 1
        for row in rows:
            if row < len(self.ft):
                self.ft[row], self.tau[row], self.touch[row], self.tip[row] = reaction(felt), tau, touch, tip

    def ran(self, diverged: np.ndarray, ticks: int | None = None) -> Ran:
        """Return the first `ticks` rows (all if None) as Ran, with worlds along the first axis."""
        arrays = (self.q, self.dq, self.tau, self.ft, self.tip, self.touch, self.true)
        return Ran(*(np.swapaxes(p[:ticks], 0, 1) for p in arrays), diverged=diverged)


def run(
    scene: Scene,
    worlds: Sequence[World],
    control: Control,
    ee_cmd: np.ndarray,
    q: np.ndarray,
    dq: np.ndarray,
    *,
    begun: float = 0.0,
    h_max: float = STEP,
    nthread: int = 1,
    sensed: ReadingNoise | None = None,
) -> Ran:
    """Simulate every world along the commanded flange poses.

    Args:
        scene: the nominal cell; its arm is the model that the controller uses.
        worlds: their effects are applied to the scene, except for those that only cameras see.
        control: the controller, of mode osc.
        ee_cmd: (n, 7) flange poses in the base, m and w x y z, one for each tick of the controller.
        q, dq: (nj,) encoder readings at the first tick, rad and rad/s.
        begun: time of the first tick on the recording's clock, s.
        h_max: greatest physics step, s.
        nthread: threads of the batch.
        sensed: noise that is added in the loop, before the encoders quantize.
    """
    tick, n, nsim = 1.0 / control.rate_hz, len(ee_cmd), len(worlds)
    nsub = max(1, math.ceil(tick / h_max - 1e-9))
    ticks, still = np.arange(n), np.tile(q, (n, 1))
    rest = np.zeros_like(still)
    segment = Segment(control, tick, {"ee_cmd": ee_cmd}, q=still, dq=rest, q_raw=still, time=ticks * tick, rows=ticks)
    rows, nominal = Rows([segment], nsim), nominal_of(scene.nominal, nsim, nthread)
    law = Controller(scene.nominal, rows, nominal, rows.by_tick(lambda s: s.q), along=False)
    start = np.tile(q, (nsim, 1))
    cell = Cell(scene, [physical(world) for world in worlds], tick / nsub, tick, nthread, [])
    weight, mass = nominal.gravity(start).copy(), nominal.operational(start)[0]
    apparent = 1.0 / np.diagonal(np.linalg.inv(mass), axis1=1, axis2=2)
    cell.start(start, np.tile(dq, (nsim, 1)), weight, apparent, begun)
    cell.use_recording_settings()
    cell.batch.forward()
    reader = Reader(n, nsim, len(q))
    with quiet(), np.errstate(all="ignore"):
        for k in range(n):
            cell.read()
            now, rate = cell.measure() if sensed is None else cell.measure(sensed.add)
            reader.true[k] = cell.x.q
            cell.advance(law.command(k, now, rate), nsub)
            reader.tick(k, cell, now, rate, cell.felt())
    return reader.ran(cell.unstable() | ~np.isfinite(reader.q).all(axis=(0, 2)))
