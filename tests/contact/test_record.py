"""The parts of a contact record: where it fails, from which values on an effect shows, what to record next."""

from __future__ import annotations

import numpy as np
from pressed import recorded

from vispeg.contact.errors.nuisance import Nuisance
from vispeg.contact.record import arrays, where_it_fails
from vispeg.contact.run import evidence_of
from vispeg.core.effect import EffectInstance

FIXTURE = EffectInstance.of("fixture_compliance", "fixture", z=3e-5)


def test_an_error_of_contact_is_not_called_one_of_free_air():
    """What all blocks share is whitened away from a press and onto the rest; failures are each block's own."""
    evidence = evidence_of([recorded((FIXTURE,))])
    (item,) = evidence.items
    predicted = [item.measured[None].copy()]
    pressed, free = (item.phase.of(name) & item.valid[:, 2] for name in ("press", "free"))
    predicted[0][0, pressed, 2] -= 3.0 * item.sigma[pressed, 2]
    evidence.nuisance = Nuisance.of(5.0 * (item.valid & (np.arange(6) == 2)).astype(float).reshape(-1, 1))
    spread = evidence.whitened([predicted[0][0]])[0]
    assert np.sum(spread[free] ** 2) > 0.1 * np.sum(spread[pressed] ** 2) > 0, "which the test of an effect allows for"
    assert where_it_fails(evidence, predicted) == [{"joint": "force z", "regime": "press", "share": 1.0}]
    assert str(arrays(evidence, predicted)["worst/moment"]).endswith("press")
