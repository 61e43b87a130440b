"""Recordings of the cell's arm that presses its peg beside the hole and slides, under the task's controller."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from vispeg.core.effect import EffectInstance
from vispeg.core.seeds import stream
from vispeg.interface.observer import DOWN
from vispeg.recordings.cell import reaction
from vispeg.recordings.recording import Control, Recording
from vispeg.sim.reach import reach
from vispeg.task.cell import Cell
from vispeg.task.control import PoseControl
from vispeg.task.peg.config import PegConfig
from vispeg.task.peg.task import PegTask
from vispeg.task.start import home
from vispeg.worlds.world import World

CONFIG = PegConfig(name="peg")
SCENE = PegTask().cell(CONFIG)
RATE = 500.0
# s, and m of the tip from the hole's mouth: down beside it, pressed, along and across, up
WAY = np.array([
    (0.0, 0.03, 0.0, 0.004), (0.6, 0.03, 0.0, 0.004), (0.8, 0.03, 0.0, -0.002), (1.1, 0.03, 0.0, -0.012),
    (1.4, 0.03, 0.0, -0.018), (1.6, 0.03, 0.0, -0.005), (2.2, 0.03, 0.02, -0.005), (2.8, 0.03, -0.005, -0.005),
    (3.0, 0.03, -0.005, 0.004),
])  # fmt: skip


MADE: dict[str, Recording] = {}


def recorded(effects: tuple[EffectInstance, ...] = (), seed: int = 0, turned: bool = False) -> Recording:
    """3 s with encoder and wrench noise; `turned`, beside the hole along y instead of x."""
    return recorded_together([effects], seed, turned)[0]


def recorded_together(
    plants: Sequence[tuple[EffectInstance, ...]], seed: int = 0, turned: bool = False
) -> list[Recording]:
    """Return such recordings of several plants, simulated side by side; repeated requests are cached."""
    keys = [repr((effects, seed, turned)) for effects in plants]
    lacking = {k: effects for k, effects in zip(keys, plants, strict=True) if k not in MADE}
    if lacking:
        MADE.update(zip(lacking, _recorded(list(lacking.values()), seed, turned), strict=True))
    return [MADE[k] for k in keys]


def _recorded(plants: Sequence[tuple[EffectInstance, ...]], seed: int, turned: bool) -> list[Recording]:
    grid, n = np.arange(int(WAY[-1, 0] * RATE) + 1) / RATE, len(plants)
    tip = np.stack([np.interp(grid, WAY[:, 0], column) for column in WAY[:, 1:].T], axis=1)
    if turned:
        tip = tip[:, [1, 0, 2]]
    pos = tip + np.array(SCENE.target) + [0.0, 0.0, SCENE.tip]
    cell = Cell(SCENE, [World().add(*effects) for effects in plants], 0.5 / RATE, 1 / RATE, 1, [])
    posture = home(SCENE)
    control = PoseControl(SCENE.nominal, n, CONFIG, posture, 1)
    start, _ = reach(control.nominal, np.tile(pos[0], (n, 1)), np.tile(DOWN, (n, 1)), np.tile(posture, (n, 1)))
    control.home = start[0]
    inertia = 1 / np.diagonal(np.linalg.inv(control.nominal.operational(start)[0]), axis1=1, axis2=2)
    cell.start(start, np.zeros_like(start), control.nominal.gravity(start).copy(), inertia)
    cell.use_recording_settings()
    angles, wrenches = [], []
    for goal in pos:
        cell.read()
        q, dq = cell.measure()
        angles.append(q.copy())
        cell.advance(control.torque(q, dq, np.tile(goal, (n, 1)), np.tile(DOWN, (n, 1))), 2)
        wrenches.append(reaction(cell.felt()))
    noise, out = {"q": 2e-5, "ft": 0.1, "ft_torque": 0.005}, []
    name = f"{'turned' if turned else 'pressed'}-{seed}"
    for row in range(n):
        rng = stream(seed, "pressed")
        q = np.array(angles)[:, row] + noise["q"] * rng.standard_normal((len(grid), 7))
        sigma = np.repeat([noise["ft"], noise["ft_torque"]], 3)
        ft = np.array(wrenches)[:, row] + sigma * rng.standard_normal((len(grid), 6))
        out.append(
            Recording(Path(name), "iiwa14", SCENE.joints, RATE, Control("unknown", RATE), grid, q, ft=ft, noise=noise)
        )
    return out
