"""The paper's protocol says how well it knows: known truths lie in its intervals, and what a path hides is said."""

from dataclasses import replace

import numpy as np
import pytest

from vispeg.cli.main import main
from vispeg.core.effect import EffectInstance
from vispeg.core.errors import UserError
from vispeg.identify.paper import intervals, protocol
from vispeg.identify.paper.intervals import determine
from vispeg.recordings.load import load
from vispeg.worlds.world import World

TRUTH = {  # by label and parameter; all else is null
    "link_mass(link4).mass": 0.8,
    "link_mass(link6).mass": -0.2,
    "viscous_friction(joint4).damping": 2.0,
    "viscous_friction(joint6).damping": 1.0,
    "gravity_tilt(base).roll": 0.006,
}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    out = tmp_path_factory.mktemp("osc") / "run"
    hidden = ["link_mass:link4:mass=0.8", "link_mass:link6:mass=-0.2", "viscous_friction:joint4:damping=2"]
    hidden += ["viscous_friction:joint6:damping=1", "gravity_tilt:base:roll=0.006"]
    args = ["record", "iiwa14", "--out", str(out), "--motion", "osc", "--duration", "4", "--seed", "3"]
    assert main([*args, "--effects", *hidden]) == 0
    return out


@pytest.fixture(scope="module")
def determined(recorded):
    pieces = protocol.cut(load(recorded))
    space = protocol.Coordinates(World(), pieces)  # the search is left out: it only begins nearer
    return space, pieces, determine(space, pieces, World())


@pytest.mark.slow
def test_truths_lie_in_their_intervals(determined):
    """95 % each: of 16, two may lie outside in one recording of forty."""
    values = {f"{e.label}.{k}": v for e in determined[2].world.effects for k, v in e.params.items()}
    outside = {k: v for k, v in values.items() if not v.low <= TRUTH.get(k, 0.0) <= v.high}
    assert len(values) == 16 and len(outside) <= 2, outside


def test_what_the_path_shows_is_sure_and_what_it_hides_is_said(determined):
    """The first link's mass rests on a vertical axis that stands: no path shows its weight."""
    values = {f"{e.label}.{k}": v for e in determined[2].world.effects for k, v in e.params.items()}
    assert "link_mass(link1).mass" in determined[2].undetermined
    assert values["link_mass(link1).mass"].high - values["link_mass(link1).mass"].low > 2.0
    for sure in ("link_mass(link4).mass", "viscous_friction(joint6).damping"):
        assert sure not in determined[2].undetermined and values[sure].low > 0, values[sure]


def test_steps_without_a_measured_pose_are_not_compared(determined):
    _, pieces, found = determined
    measured = pieces.measured.copy()
    measured[0, :3] = np.nan
    some = replace(pieces, measured=measured)
    (path,) = protocol.paths(some, [found.world])
    left = np.linalg.norm((pieces.measured - path)[0, 3:])
    assert protocol.cost(some, path) == pytest.approx(
        protocol.cost(pieces, path) - np.linalg.norm((pieces.measured - path)[0]) + left
    )


def test_a_given_models_values_at_all_places_are_where_the_fit_begins(recorded):
    """`damping 2 at all joints` moves the flange as 2 at each of them does, and no dead entry stays."""
    every = [EffectInstance.of("viscous_friction", "all", damping=2.0), EffectInstance.of("link_mass", "all", mass=0.5)]
    given = World(effects=(*every, EffectInstance.of("viscous_friction", "joint2", damping=1.0)))
    pieces = protocol.cut(load(recorded))
    space = protocol.Coordinates(given, pieces)
    start = space.at(space.start)
    values = {e.label: v.value for e in start.effects for v in e.params.values() if e.effect != "gravity_tilt"}
    expected = {f"link_mass({link})": 0.5 for link in pieces.robot.links}
    expected |= {f"viscous_friction({j})": 1.0 if j == "joint2" else 2.0 for j in pieces.robot.joints}
    assert values == pytest.approx(expected)
    np.testing.assert_allclose(*protocol.paths(pieces, [given, start]), atol=1e-9)


def test_samples_without_a_measured_pose_tell_nothing(recorded):
    """A tracker that reads at every fifth sample: as sure as those samples alone, and less sure than all of them."""
    whole = protocol.cut(load(recorded))
    kept = np.arange(protocol.STEPS) % 5 == 4
    few = replace(whole, measured=np.where(kept[:, None], whole.measured, np.nan))
    alone = replace(
        whole,
        segments=tuple(replace(s, time=s.time[kept], rows=s.rows[kept]) for s in whole.segments),
        measured=whole.measured[:, kept],
    )
    space = protocol.Coordinates(World(), whole)
    space.axes = [axis for axis in space.axes if axis[:2] in (("viscous_friction", "joint4"), ("link_mass", "link6"))]
    half = [
        intervals._half_widths(space, *intervals._slope(space, p, space.start, 1), p.compared)
        for p in (whole, few, alone)
    ]
    assert half[1] == pytest.approx(half[2]) and (half[1] > half[0]).all()


def test_missing_angles_are_no_positions_where_the_flange_was_not_measured(determined, recorded):
    rec = replace(load(recorded), ee=None)
    gone = rec.q.copy()
    gone[400:405] = np.nan
    whole, some = protocol.cut(rec), protocol.cut(replace(rec, q=gone))
    (path,) = protocol.paths(whole, [World()])
    assert protocol.cost(some, path) == pytest.approx(protocol.cost(whole, path), rel=0.05)
    ee = load(recorded).ee.copy()
    ee[: len(ee) // 8] = np.nan  # more than a ninth
    with pytest.raises(UserError, match="a piece without a measured pose"):
        protocol.cut(replace(rec, ee=ee))


def test_it_ends_at_the_cost_of_the_truth(determined):
    space, pieces, found = determined
    truth = World().add(
        *(e.with_values(**{k: TRUTH.get(f"{e.label}.{k}", 0.0) for k in e.params}) for e in found.world.effects)
    )
    before, after, true = (protocol.cost(pieces, y) for y in protocol.paths(pieces, [World(), found.world, truth]))
    assert after <= 1.02 * true < 0.3 * before
