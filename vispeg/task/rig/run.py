"""One closed loop in the cell: worlds side by side under a recorded controller, and what their sensors read."""

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
from vispeg.worlds.world import World

STEP = 5e-4  # s, greatest physics step: contact is stiff


@dataclass(frozen=True)
class Ran:
    """What the sensors of the simulated cells read at the control ticks, (nworld, n, ..).

    Attributes:
        q, dq, tau: (.., nj) rad, rad/s, N m behind the gear.
        ft: (.., 6) N, N m: what the flange exerts on the tool, in the flange's frame.
        tip: (.., 3) m, true place of the tip in the true goal's frame.
        touch: (..,) N, true contact force of the tick that ends there, the mean of its steps.
        true: (.., nj) rad, where the joints are, which only a bystander (a camera) can see; NaN where nobody looked.
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
    """Keeps what the sensors of a cell say tick by tick: a row holds the readings from which its command follows."""

    def __init__(self, ticks: int, nsim: int, nj: int):
        self.q, self.dq, self.tau = (np.zeros((ticks, nsim, nj)) for _ in range(3))
        self.true = np.full((ticks, nsim, nj), np.nan)
        self.ft, self.tip, self.touch = np.zeros((ticks, nsim, 6)), np.zeros((ticks, nsim, 3)), np.zeros((ticks, nsim))

    def tick(self, k: int, cell: Cell, q: np.ndarray, dq: np.ndarray, felt: np.ndarray) -> None:
        """After the steps of tick k, at whose begin the encoders said q, dq; the rest is what is read at the next."""
        self.q[k], self.dq[k] = q, dq
        offset = cell.site_position("tip") - cell.site_position("goal")
        tip = np.einsum("nji,nj->ni", cell.site_rotation("goal"), offset)
        touch, tau = np.linalg.norm(cell.read_out[:, 7:10], axis=1), cell.gear_torque()
        rows = [0, 1] if k == 0 else [k + 1]  # nothing was measured before the first step
        for row in rows:
            if row < len(self.ft):
                self.ft[row], self.tau[row], self.touch[row], self.tip[row] = reaction(felt), tau, touch, tip

    def ran(self, diverged: np.ndarray, ticks: int | None = None) -> Ran:
        """All of it, worlds first."""
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
    h_max: float = STEP,
    nthread: int = 1,
    sensed: ReadingNoise | None = None,
) -> Ran:
    """Drives every world along the commanded flange poses, as the robot was driven.

    Args:
        scene: the nominal cell, whose arm is what the controller knows.
        worlds: their effects, placed on the scene.
        control: of mode osc.
        ee_cmd: (n, 7) flange poses, one a tick of the controller.
        q, dq: (nj,) what the encoders say at the first tick, rad and rad/s.
        h_max: greatest physics step, s.
        nthread: threads of the batch.
        sensed: noise that the encoders have before they round.
    """
    tick, n, nsim = 1.0 / control.rate_hz, len(ee_cmd), len(worlds)
    nsub = max(1, math.ceil(tick / h_max - 1e-9))
    still = np.tile(q, (n, 1))
    segment = Segment(control, tick, {"ee_cmd": ee_cmd}, still, np.zeros_like(still), still, *_clock(n, tick))
    rows, nominal = Rows([segment], nsim), nominal_of(scene.nominal, nsim, nthread)
    law = Controller(scene.nominal, rows, nominal, rows.by_tick(lambda s: s.q), along=False)
    start = np.tile(q, (nsim, 1))
    cell = Cell(scene, worlds, tick / nsub, tick, nthread, [])
    weight, mass = nominal.gravity(start).copy(), nominal.operational(start)[0]
    apparent = 1.0 / np.diagonal(np.linalg.inv(mass), axis1=1, axis2=2)
    cell.start(start, np.tile(dq, (nsim, 1)), weight, apparent)
    cell.recorded()
    cell.batch.forward()
    reader, bad = Reader(n, nsim, len(q)), np.zeros(nsim, bool)
    with quiet(), np.errstate(all="ignore"):
        for k in range(n):
            cell.read()
            now, rate = cell.measure() if sensed is None else cell.measure(sensed.add)
            reader.true[k] = cell.x.q
            cell.advance(law.command(k, now, rate), nsub)
            reader.tick(k, cell, now, rate, cell.felt())
    bad |= cell.unstable() | ~np.isfinite(reader.q).all(axis=(0, 2))
    return reader.ran(bad)


def _clock(n: int, tick: float) -> tuple[np.ndarray, np.ndarray]:
    return np.arange(n) * tick, np.arange(n)
