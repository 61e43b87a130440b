"""A load at the flange that came in as masses and centres of links is put together again."""

from __future__ import annotations

import pytest
from loops import iiwa_segment, recorded

from vispeg.core.effect import EffectInstance
from vispeg.core.seeds import stream
from vispeg.diagnosis.selection.gather import gathered
from vispeg.diagnosis.selection.judge import Judge
from vispeg.diagnosis.selection.search import Search
from vispeg.identify.evidence import Evidence
from vispeg.robots.model import load
from vispeg.worlds.world import World

LOAD = EffectInstance.of("payload", "flange", mass=0.6, x=0.01, y=-0.02, z=0.06)
HEAVIER = EffectInstance.of("link_mass", "link6", mass=0.5)


def searched(hidden: EffectInstance, taken: list[EffectInstance]) -> tuple[Search, object]:
    """A search on three motions of an arm with `hidden`, and its state with what was `taken` for it, fitted."""
    robot, world = load("iiwa14"), World().add(hidden)
    motions = [iiwa_segment("position", seconds=2.5, seed=k) for k in range(3)]
    recordings = [recorded(robot, "iiwa14", world, s, stream(5, k)) for k, s in enumerate(motions)]
    search = Search(Evidence(recordings[:2]), Judge(Evidence(recordings[2:])))
    return search, search.start(World("iiwa14").add(*taken), 0)


def test_a_payload_replaces_effects_of_the_last_links():
    """One effect of five parameters instead of three of seven, and a smaller error."""
    links = [EffectInstance.of("link_com", f"link{k}", x=1e-3) for k in (6, 7)]
    search, state = searched(LOAD, [*links, HEAVIER])
    before = search.judge.mean(state.loss)
    assert gathered(search, state, 0)
    (found,) = state.world.effects
    assert found.label == "payload(flange)" and search.judge.mean(state.loss) < 0.5 * before
    assert found.params["mass"].value == pytest.approx(0.6, rel=0.02)
    assert not gathered(search, state, 0), "links have nothing any more"


@pytest.mark.slow
def test_a_heavy_link_is_no_load():
    """What a link was given rightly stays."""
    search, state = searched(HEAVIER, [HEAVIER])
    assert not gathered(search, state, 0)
    assert [e.label for e in state.world.effects] == ["link_mass(link6)"]
