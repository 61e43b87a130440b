"""Looks that are too short: refused with the time that they take, whatever was asked for."""

from __future__ import annotations

import re

import pytest

from vispeg.core.errors import UserError
from vispeg.identify.motions.look_motion import look_motion
from vispeg.task.peg.config import PegConfig
from vispeg.task.peg.task import PegTask


@pytest.mark.slow
def test_the_least_duration_is_one_figure_and_true():
    scene = PegTask().cell(PegConfig(name="peg"))
    said = set()
    for duration in (5.0, 12.0):
        with pytest.raises(UserError, match="too fast") as error:
            look_motion("look-fast", scene, 50.0, duration)
        said.add(re.search(r"([\d.]+) s or more", str(error.value))[1])
    (least,) = map(float, said)
    assert look_motion("look-fast", scene, 50.0, least).time[-1] == pytest.approx(least, abs=0.05)
    with pytest.raises(UserError, match="too fast"):
        look_motion("look-fast", scene, 50.0, least - 0.2)
