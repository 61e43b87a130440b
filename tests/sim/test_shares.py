"""Work shared among processes: the same answer to the bit, and the same errors."""

import os
from pathlib import Path

import numpy as np
import pytest

from vispeg.core.effect import EffectInstance
from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.identify.evidence import Evidence
from vispeg.identify.excitation import motion
from vispeg.identify.record import centre_of, controller, record
from vispeg.recordings.noise import NOISE
from vispeg.robots.model import load
from vispeg.sim.shares import processes, shared
from vispeg.worlds.world import World


def worlds(n: int) -> list[World]:
    """Half of them with friction, half with a delayed encoder."""
    first, second = ("coulomb_friction", "torque"), ("sensor_delay", "delay")
    kinds = [first if i < n // 2 else second for i in range(n)]
    sizes = np.linspace(0.1, 1.0, n)
    return [
        World().add(EffectInstance.of(name, "joint4", **{p: float(x if p == "torque" else 4e-3 * x)}))
        for (name, p), x in zip(kinds, sizes, strict=True)
    ]


def test_processes_change_no_bit():
    robot = load("iiwa14")
    control = controller(robot, "position", 500.0, centre_of(robot))
    recs = [
        record(World(), motion("fourier", robot, 500.0, s, stream(0, s)), control, NOISE, stream(1, s))
        for s in (1.0, 1.2)
    ]
    some = worlds(9)
    alone = Evidence(recs, nthread=1).residuals(some)
    for count in (2, 3):
        for a, b in zip(alone, Evidence(recs, nthread=count).residuals(some), strict=True):
            np.testing.assert_array_equal(a, b)


def test_every_share_is_worked_out_by_another_process():
    def work(some):
        return [np.full((len(some), 2), float(os.getpid()))]

    ids = shared(work, worlds(8), [(2,)], 2)[0]
    assert ids.shape == (8, 2)
    assert np.all(ids[:4] == os.getpid())
    assert len(np.unique(ids[4:])) == 1 and ids[4, 0] != os.getpid()


def test_an_error_of_a_child_is_the_parents():
    def work(some):
        if some[0] is not first:
            raise UserError("a place that is not there")
        return [np.zeros((len(some), 1))]

    everyone = worlds(8)
    first = everyone[0]
    with pytest.raises(UserError, match="a place that is not there"):
        shared(work, everyone, [(1,)], 2)


def test_a_child_that_dies_is_replaced():
    parent = os.getpid()

    def work(some):
        if os.getpid() != parent:
            os._exit(9)
        return [np.arange(float(len(some)))[:, None]]

    np.testing.assert_array_equal(shared(work, worlds(8), [(1,)], 2)[0].ravel(), [0, 1, 2, 3, 0, 1, 2, 3])


def children() -> list[str]:
    """This process's children, the dead ones that nobody has asked after included."""
    return sorted(Path(f"/proc/{os.getpid()}/task/{os.getpid()}/children").read_text().split())


def test_nothing_is_left_of_an_interrupted_call():
    parent = os.getpid()

    def work(some):
        if os.getpid() == parent:
            raise KeyboardInterrupt
        return [np.zeros((len(some), 1))]

    before = children()
    with pytest.raises(KeyboardInterrupt):
        shared(work, worlds(8), [(1,)], 2)
    assert children() == before


def test_few_worlds_are_worth_one_process():
    assert processes(2, 3) == processes(1, 100) == 1
    assert processes(8, 9) <= 2
