"""`fit` of what a person chose in the cell: values, and intervals that hold what is not there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pressed import recorded

from vispeg.api.fit import fit
from vispeg.contact.run import evidence_of
from vispeg.core.effect import EffectInstance
from vispeg.recordings.cell import WrenchSensor
from vispeg.worlds.world import World

FRICTION = EffectInstance.of("contact_friction", "peg", scale=1.7)


def test_the_error_of_a_world_is_one_number():
    """As in a joint diagnosis: of the nominal world more than of the true one."""
    evidence = evidence_of([recorded((FRICTION,))])
    nominal, true = evidence.errors([World(), World().add(FRICTION)])
    assert evidence.unit == "N" and 0 < true < 0.5 * nominal


def lost(rec, rows, axes=slice(None)):
    ft = rec.ft.copy()
    ft[rows, axes] = np.nan
    return replace(rec, ft=ft, wrench=WrenchSensor())


@pytest.mark.parametrize("axes", [pytest.param(slice(None), marks=pytest.mark.slow), 2], ids=["all axes", "one axis"])
def test_samples_that_a_force_sensor_lost_are_left_out(axes):
    """One in seven, and 0.2 s of a press in a row: errors stay what they were, and the gap's blocks do not count."""
    rec = recorded((FRICTION,))
    worlds = [World(), World().add(FRICTION)]
    nominal, true = evidence_of([rec]).errors(worlds)
    scattered, gap = (evidence_of([lost(rec, rows, axes)]) for rows in (slice(3, None, 7), slice(900, 1000)))
    for evidence in (scattered, gap):
        errors = evidence.errors(worlds)
        assert errors[0] == pytest.approx(nominal, rel=0.15) and errors[1] < 1.3 * true
        assert np.isfinite(evidence.floors).all()
        assert any("missing" in note and "ft." in note for note in evidence.notes)
    (item,) = gap.items
    blocks = (item.phase.time > 1.81) & (item.phase.time < 1.99)
    assert blocks.sum() == 5 and not item.valid[blocks].any()
    before = evidence_of([rec]).items[0].valid
    assert item.valid.any(axis=1).sum() >= before.any(axis=1).sum() - 9, "little more than the gap is left out"


def test_a_fit_tells_what_is_there_from_what_is_not(tmp_path):
    recordings = [recorded((FRICTION,)), *(recorded((FRICTION,), seed, turned=True) for seed in (0, 2))]
    held_out = [recorded((FRICTION,), seed=1)]
    found = fit("peg-cell", recordings, ["contact_friction:peg", "wrench_gain:flange"], held_out)
    values = {e.effect: [*e.params.values()][0] for e in found.effects}
    friction, gain = values["contact_friction"], values["wrench_gain"]
    assert friction.low < 1.7 < friction.high and friction.low > 1.3
    assert gain.low < 1.0 < gain.high, "the sensor is right"
    before, after = (found.world.effects[-1].origin[f"heldout_error_{k}"] for k in ("before", "after"))
    assert after < 0.5 * before
    found.save(tmp_path / "out")
    assert (tmp_path / "out" / "model.yaml").exists() and (tmp_path / "out" / "fit.json").exists()
