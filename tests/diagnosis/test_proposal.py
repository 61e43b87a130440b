"""Effects that torques call for, before any rollout."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from vispeg.core.effect import REGISTRY, EffectInstance
from vispeg.core.seeds import stream
from vispeg.diagnosis.proposal import linear_of, propose
from vispeg.identify.drives import Drives
from vispeg.identify.evidence import Evidence
from vispeg.identify.excitation import motion
from vispeg.identify.record import centre_of, controller, record
from vispeg.recordings.noise import NOISE
from vispeg.recordings.recording import Control
from vispeg.robots.model import load
from vispeg.worlds.world import World

HIDDEN = World().add(
    EffectInstance.of("coulomb_friction", "joint4", torque=1.5),
    EffectInstance.of("viscous_friction", "joint2", damping=4.0),
    EffectInstance.of("payload", "flange", mass=0.8, x=0.02, y=0.0, z=0.06),
    EffectInstance.of("cable_spring", "joint6", stiffness=1.5, reference=0.3),
)


def recorded(world, seed, mode="position", seconds=3.5):
    robot = load("iiwa14")
    move = motion("fourier", robot, 500.0, seconds, stream(seed, "test", "motion"))
    control = controller(robot, mode, 500.0, centre_of(robot))
    return record(world, move, control, NOISE, stream(seed, "test", "noise"), torque_sensor="motor", name=f"rec-{seed}")


@pytest.fixture(scope="module")
def sides():
    return [recorded(HIDDEN, 1)], [recorded(HIDDEN, 2)]


def names(proposal):
    return {(n.placed.effect, n.placed.where) for n in proposal.named}


def test_what_a_controller_sent_names_several_effects_and_their_sizes(sides):
    proposal = propose(World(), *sides)
    assert {(e.effect, e.where) for e in HIDDEN.effects} <= names(proposal)
    assert len(proposal.named) <= len(HIDDEN.effects) + 1
    found = {n.placed.label: n.placed for n in proposal.named}
    for e in HIDDEN.effects:
        magnitude = next(iter(e.params))
        assert found[e.label].params[magnitude].value == pytest.approx(e.params[magnitude].value, rel=0.06)
    assert not proposal.measured
    assert proposal.errors[1] < 0.1 * proposal.errors[0]


def test_measured_torques_of_an_unknown_controller_say_the_same(sides):
    measured = [
        [replace(r, control=Control("unknown", 500.0), q_cmd=None, dq_cmd=None, torque_sensor="motor") for r in side]
        for side in sides
    ]
    proposal = propose(World(), *measured)
    assert proposal.measured
    assert {(e.effect, e.where) for e in HIDDEN.effects} <= names(proposal)


def test_nothing_is_proposed_for_the_right_model(sides):
    assert not propose(HIDDEN, *sides).named


@pytest.fixture(scope="module")
def linear(sides):
    return linear_of(World(), *sides)


@pytest.mark.parametrize(
    "new, count", [("payload(flange)", 3), ("hysteresis(joint2)", 0), ("rotor_inertia(joint3)", 0)]
)
def test_one_effect_takes_the_place_of_all_that_it_makes_superfluous(linear, new, count):
    """As the best of all sets with it and some of the others does; a load makes the three links superfluous."""
    labels = [s.probe.label for s in linear.entries]
    links = ("link_com(link6)", "link_com(link7)", "link_mass(link7)")
    beside = ("cable_spring(joint6)", "viscous_friction(joint2)", "joint_bias(joint4)")
    chosen, k = [labels.index(e) for e in (*links, *beside)], labels.index(new)
    subsets = (c for n in range(len(chosen) + 1) for c in combinations(chosen, n))
    best = max((sorted([*c, k]) for c in subsets), key=linear.merit)
    move = linear.in_place(chosen, k)
    if not count:
        assert move is None and best == sorted([*chosen, k])
        return
    assert move == (linear.merit(best), f"{', '.join(links)} > {new}", best)


def test_what_is_too_short_for_torques_is_left_out(sides):
    """Episodes of 0.9 s can be compared by rollouts, and their torques are all in the filter's transients."""
    (good,), _ = sides
    one = recorded(HIDDEN, 3, seconds=0.9)
    n, joined = len(one.time), {k: np.tile(getattr(one, k), (3, 1)) for k in ("q", "dq", "tau", "q_cmd", "dq_cmd")}
    time = np.concatenate([one.time + k for k in range(3)])
    short = replace(one, time=time, episode=np.repeat(range(3), n), **joined)
    assert len(Evidence([short]).items) == 3
    assert not Drives([short]) and propose(World(), [short], [good]) is None
    some, alone = Drives([good, short]), Drives([good])
    assert some.recordings == [good]
    np.testing.assert_array_equal(some.torque, alone.torque)


def test_no_torque_no_proposal(sides):
    blind = [[replace(r, control=Control("unknown", 500.0), tau=None, torque_sensor="none") for r in s] for s in sides]
    assert propose(World(), *blind) is None
    assert propose(World(), blind[0], []) is None and propose(World(), [], []) is None


@pytest.mark.parametrize("name", sorted(n for n, e in REGISTRY.items() if e.overrides("regressor")))
def test_a_regressor_is_the_torque_that_its_effect_takes(name):
    kind = REGISTRY[name]
    where = "all" if kind.shared else kind.targets(load("iiwa14"))[1]
    small = {m: p.null + 0.75 * (p.start - p.null) for m, p in kind.params.items() if not p.shape}
    world = World().add(EffectInstance.of(name, where, **small))
    drives = Drives([recorded(world, 3, seconds=2.0)])
    inside = drives.valid & (np.abs(drives.dq) > 0.05)
    without, beside = (np.where(inside, drives.torque - needed, 0.0) for needed in drives.needed([World(), world]))
    assert np.sum(beside**2) < 0.05 * np.sum(without**2)


def test_a_link_is_not_made_lighter_than_nothing():
    model = load("iiwa14").compile()
    low, _ = REGISTRY["link_mass"].limits(model, "link5")["mass"]
    assert -model.body("link5").mass[0] < low < 0
