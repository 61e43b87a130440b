"""What the missing torque of a final model depends on."""

from dataclasses import replace

import numpy as np
import pytest

from vispeg.core.seeds import stream
from vispeg.diagnosis.evidence.localise import MissingTorque
from vispeg.diagnosis.evidence.remainder import dependences


def trembling(seconds: float, part: float = 1.0) -> MissingTorque:
    """Two joints of which one misses a torque of 1 N m at 5 Hz, and white noise of the rest of its power."""
    time = np.arange(round(100 * seconds)) / 100.0
    q = np.sin(np.outer(time, [0.7, 1.1]))
    rng = stream(1, seconds)
    excess = np.zeros_like(q)
    excess[:, 1] = np.sqrt(part) * np.sin(2 * np.pi * 5.0 * time)
    excess[:, 1] += np.sqrt((1.0 - part) / 2) * rng.standard_normal(len(time))
    return MissingTorque(time, q, q, q, q, q, excess, np.full(2, 0.01))


@pytest.mark.parametrize("part", [1.0, 0.5])
@pytest.mark.parametrize("seconds", [(20.0,), (20.0, 2.0), (2.0, 20.0)])
def test_a_line_has_its_share_of_the_power_whatever_the_recordings_lengths(part, seconds):
    held_out = [trembling(s, part) for s in seconds]
    (line,) = [d for d in dependences([trembling(20.0)], held_out, ("a", "b")) if d.input.startswith("frequency")]
    assert line.input == "frequency (5.0 Hz)" and line.joint == "b"
    assert line.share == pytest.approx(part, abs=0.02 if part == 1.0 else 0.1)


def test_shares_are_of_each_recordings_own_noise_in_any_order():
    """Two held-out recordings miss the same spring torque; the noise of one is 100 times that of the other."""
    precise = trembling(20.0)
    precise = replace(precise, excess=0.5 * precise.q + 0.1 * precise.excess)
    coarse = replace(precise, sigma=100.0 * precise.sigma)
    ranked = [dependences([precise], held_out, ("a", "b")) for held_out in ([precise, coarse], [coarse, precise])]
    shares, reverse = ({d.input: d.share for d in some if not d.input.startswith("frequency")} for some in ranked)
    assert shares == reverse and max(shares.values()) <= 1.0
    (alone,) = [d.share for d in dependences([precise], [precise], ("a", "b")) if d.input == "position"]
    assert shares["position"] == pytest.approx(alone, abs=0.002), "the coarse one hardly counts"
