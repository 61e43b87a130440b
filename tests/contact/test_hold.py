"""An error of the path and one of the reading weigh the same in newtons as read, whatever these stand for."""

import numpy as np
from pressed import recorded

from vispeg.contact.hand import stiffness
from vispeg.contact.items import driven, predicted
from vispeg.contact.run import evidence_of
from vispeg.core.effect import EffectInstance
from vispeg.worlds.world import World

MM = 1e-3


def test_an_error_of_the_path_costs_the_same_for_every_gain_of_the_sensor():
    """A fixture 1 mm too high in the model: what is left while it presses is the hold's spring, for every gain.

    By half a gain, a press of half the force would be left, and a weak sensor would explain any misplaced surface.
    """
    item = evidence_of([recorded()]).items[0]
    raised = EffectInstance.of("hole_offset", "fixture", z=MM)
    left = []
    for gain in (1.0, 0.5, 2.0):
        weak = World().add(EffectInstance.of("wrench_gain", "flange", gain=gain))
        worlds = [weak, weak.add(raised)]
        even, off = predicted(item, driven(item, worlds), worlds)
        presses = item.phase.of("press") & item.phase.valid & ~item.phase.resting
        left.append(np.median((off - even)[presses], axis=0))
    assert np.linalg.norm(left[0][:3]) > 0.8 * stiffness()[2] * MM
    for other in left[1:]:
        np.testing.assert_allclose(other[:3], left[0][:3], atol=0.1 * np.linalg.norm(left[0][:3]))
