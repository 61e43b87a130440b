"""Identification's rollout and the training cell are one physics: they differ by their integrators' error alone."""

import numpy as np
import pytest

from vispeg.core.effect import EffectInstance, effect, searchable
from vispeg.robots.scene import build
from vispeg.robots.scene_config import SceneConfig
from vispeg.sim.compiled import nominal_of
from vispeg.sim.plant import Plant
from vispeg.task.cell import Cell
from vispeg.worlds.world import World

TICK = 5e-3  # s, a controller's period
HOME = np.array([0.0, 0.6, 0.0, -1.6, 0.0, 0.95, 0.0])
SWING = 0.15 * np.array([1, -1, 1, 1, 1, -1, 1])  # rad, away from the table
SCENE = build(SceneConfig(), ())
ARM = sorted(searchable())
NOISE = 2e-5  # rad, an encoder's


def worlds(names, seed):
    """One world an effect, at a place and with parameters of this seed, in the lower half of their range."""
    rng = np.random.default_rng(seed)
    out = []
    for name in names:
        kind = effect(name)
        targets = [t for t in kind.targets(SCENE) if t not in ("peg", "tool")]
        values = {k: p.start * rng.uniform(0.5, 1.5) for k, p in kind.params.items()}
        values = {k: float(np.clip(v, kind.params[k].low, kind.params[k].high)) for k, v in values.items()}
        out.append(World(effects=(EffectInstance.of(name, targets[rng.integers(len(targets))], **values),)))
    return out


def servo(plant, advance, nominal, inertia, seconds=0.4):
    """Angles of the links (ticks, nsim, nj) rad and torque of the gears N m, under a servo that swings out and back."""
    links, geared = [], []
    for k in range(round(seconds / TICK)):
        plant.read()
        q, dq = plant.measure()
        links.append(plant.x.q.copy())
        geared.append(plant.x.tau.copy())
        goal = HOME + SWING * (1 - np.cos(2 * np.pi * 1.5 * k * TICK))
        advance(inertia * (225 * (goal - q) - 30 * dq) + nominal.gravity(q))
    return np.array(links), np.array(geared)


def played(names, nsub, cell, seed=0):
    """The arms of `names`, one effect a row, stepped `nsub` times a tick by the cell or by identification's plant."""
    drawn, n = worlds(names, seed), len(names)
    nominal = nominal_of(SCENE.nominal, n)
    q0 = np.tile(HOME, (n, 1))
    weight = nominal.gravity(q0).copy()
    apparent = 1 / np.diagonal(np.linalg.inv(nominal.operational(q0)[0]), axis1=1, axis2=2)
    plant = Plant(SCENE, drawn, TICK / nsub, TICK, 1)
    plant.start(q0, np.zeros_like(q0), weight, apparent)
    if not cell:

        def advance(command):
            for sub in range(nsub):
                if sub:
                    plant.read()
                plant.step(command, 0.0)

        return servo(plant, advance, nominal, apparent)
    links = plant.qpos[:, plant.qadr].copy()  # the plant begins where its encoders read HOME
    here = Cell(SCENE, drawn, TICK / nsub, TICK, 1, list(names))
    here.start(links, np.zeros_like(q0), weight, apparent)
    here.begin(np.arange(n), drawn, links, weight)
    return servo(here, lambda command: here.advance(command, nsub), nominal, apparent)


@pytest.fixture(scope="module")
def differences():
    """By effect: greatest difference of a link's angle between cell and plant, rad, at 1.67 and at 0.21 ms."""
    reference = played(ARM, 24, cell=False)[0]
    by_step = [np.abs(played(ARM, n, cell=True)[0] - reference).max(axis=(0, 2)) for n in (3, 24)]
    return dict(zip(ARM, zip(*by_step, strict=True), strict=True))


@pytest.mark.parametrize("name", ARM)
def test_what_is_identified_is_what_is_trained(differences, name):
    """The difference is small at the task's step and vanishes with the step, of first order at least."""
    coarse, fine = differences[name]
    assert coarse < 50 * NOISE
    assert fine < max(coarse / 3, NOISE)


@pytest.mark.parametrize("name", ["load_friction", "joint_elasticity", "hysteresis", "payload"])
def test_the_gear_carries_the_same_torque_in_both(name):
    """`x.tau`, by the wrench between the links in the cell and by the drive's parts in the plant."""
    torque = [played([name, "joint_elasticity"], 24, cell)[1][:, 0] for cell in (True, False)]
    swing = np.ptp(torque[1], axis=0)
    assert np.abs(torque[0] - torque[1])[1:].max(axis=0) == pytest.approx(0, abs=0.02 * swing.max())


def test_the_clock_of_effects_begins_with_each_episode():
    """`x.t` counts the physics steps, and a row that begins anew counts from zero."""
    drawn = worlds(["viscous_friction"] * 2, 0)
    cell, q0 = Cell(SCENE, drawn, TICK / 3, TICK, 1, []), np.tile(HOME, (2, 1))
    weight = nominal_of(SCENE.nominal, 2).gravity(q0).copy()
    cell.start(q0, np.zeros_like(q0), weight, np.ones_like(q0))
    cell.read()
    cell.advance(weight, 3)
    cell.begin(np.array([1]), drawn[1:], q0[1:], weight[1:])
    np.testing.assert_allclose(cell.x.t, [[TICK], [0.0]], atol=1e-12)


def test_steps_at_once_are_steps_one_by_one():
    """What follows from the command alone is asked without a look at the arm between the steps, with the same bits."""
    names, nsub = ["actuator_lag", "command_delay", "torque_gain"], 3
    ends = []
    for at_once in (True, False):
        cell = Cell(SCENE, worlds(names, 0), TICK / nsub, TICK, 1, names)
        q0 = np.tile(HOME, (len(names), 1))
        cell.start(q0, np.zeros_like(q0), nominal_of(SCENE.nominal, len(names)).gravity(q0).copy(), np.ones_like(q0))
        for command in np.random.default_rng(1).normal(0.0, 5.0, (12, *q0.shape)):
            cell.read()
            if at_once:
                cell.advance(command, nsub)
                continue
            for sub in range(nsub):
                if sub:
                    cell.read()
                cell.advance(command, 1)
        ends.append(np.concatenate([cell.qpos, cell.qvel, cell.acc, cell.x.tau], axis=1).copy())
    np.testing.assert_array_equal(*ends)
