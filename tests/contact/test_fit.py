"""`fit` of what a person chose in the cell: values, and intervals that hold what is not there."""

from __future__ import annotations

from pressed import recorded

from vispeg.api.fit import fit
from vispeg.contact.run import evidence_of
from vispeg.core.effect import EffectInstance
from vispeg.worlds.world import World

FRICTION = EffectInstance.of("contact_friction", "peg", scale=1.7)


def test_the_error_of_a_world_is_one_number():
    """As in a joint diagnosis: of the nominal world more than of the true one."""
    evidence = evidence_of([recorded((FRICTION,))])
    nominal, true = evidence.errors([World(), World().add(FRICTION)])
    assert evidence.unit == "N" and 0 < true < 0.5 * nominal


def test_a_fit_tells_what_is_there_from_what_is_not(tmp_path):
    recordings = [recorded((FRICTION,)), recorded((FRICTION,), turned=True)]
    found = fit("peg-cell", recordings[:1], ["contact_friction:peg", "wrench_gain:flange"], recordings[1:])
    values = {e.effect: [*e.params.values()][0] for e in found.effects}
    friction, gain = values["contact_friction"], values["wrench_gain"]
    assert friction.low < 1.7 < friction.high and friction.low > 1.3
    assert gain.low < 1.0 < gain.high, "the sensor is right"
    before, after = (found.world.effects[-1].origin[f"heldout_error_{k}"] for k in ("before", "after"))
    assert after < 0.5 * before
    found.save(tmp_path / "out")
    assert (tmp_path / "out" / "model.yaml").exists() and (tmp_path / "out" / "fit.json").exists()
