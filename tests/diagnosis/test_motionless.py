"""A recording without motion is refused in one line; one in which a command or a joint moves is not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.diagnosis.evidence.motionless import motionless, refuse_motionless
from vispeg.recordings.recording import Control, Recording

TIME = np.arange(2000) * 2e-3
SWING = 0.2 * np.sin(2 * np.pi * TIME)[:, None]


def rec(name="still", q=0.0, q_cmd=0.0, noise=2e-5, **signals):
    reading = 0.3 + q + noise * stream(1, name).standard_normal((len(TIME), 1))
    control = Control("position", 500.0, "none", np.array([60.0]), np.array([4.0]))
    command = np.broadcast_to(np.asarray(0.3 + q_cmd, float), (len(TIME), 1)).copy()
    made = Recording(Path(name), "arm.xml", ("hinge",), 500.0, control, TIME, reading, q_cmd=command)
    return replace(made, noise={"q": noise}, **signals)


def test_noise_is_no_motion_and_the_smallest_swing_is():
    assert motionless(rec()) and motionless(rec(noise=1e-3))
    assert motionless(rec(q_cmd=np.full((len(TIME), 1), 0.2))), "sagging under a fixed command"
    assert not motionless(rec(q=0.01 * SWING))
    assert not motionless(rec(q_cmd=SWING)), "a joint that stays where it is though commanded is stuck: that tells much"
    assert not motionless(rec(tau_cmd=5.0 * SWING))
    gone = rec()
    gone.q[3:50] = np.nan
    assert motionless(gone) and motionless(replace(gone, tau_cmd=np.full((len(TIME), 1), np.nan)))


def test_all_still_is_refused_and_one_of_two_is_noted():
    still, moving = rec(), rec("moving", SWING, SWING)
    with pytest.raises(UserError, match="still: there is no motion to learn from"):
        refuse_motionless([still], [moving])
    with pytest.raises(UserError, match="still: there is no motion to judge on.*1 others"):
        refuse_motionless([moving], [still, rec("also")])
    assert refuse_motionless([moving, still], [moving]) == [
        "still has no motion to learn from: no joint and no command moves"
    ]
    assert refuse_motionless([moving], [moving]) == []
