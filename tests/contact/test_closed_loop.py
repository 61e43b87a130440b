"""An insertion run again in closed loop: the right model ends as the hidden cell did, and with its peak force."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from vispeg.contact.again.closed_loop import closed_loop
from vispeg.core.effect import EffectInstance
from vispeg.core.seeds import stream
from vispeg.recordings.cell import CellBelief
from vispeg.recordings.noise import NOISE
from vispeg.robots.tools import CELL
from vispeg.task.belief import believed
from vispeg.task.rig.motions import CellMotion, Place
from vispeg.task.rig.path import commands
from vispeg.task.rig.record import record_cell
from vispeg.worlds.world import World

MODEL = World("iiwa14", CELL, cell=CellBelief("nominal"))
FOUND = believed(MODEL.cell)
HIDDEN = {
    "tilted": EffectInstance.of("hole_tilt", "fixture", roll=0.03),
    "too tight": EffectInstance.of("hole_clearance", "fixture", width=-3.4e-3),
}


@cache
def insertion(hidden):
    """A short one: in, against the wall on one side, to the bottom."""
    place = Place(FOUND.scene, stream(1, "closed loop"))
    path = place.begin().to(0.5, tip=(0, 0, 0.004)).to(0.8, tip=(0, 0, -0.8 * place.depth), force=(0, 0, -8.0))
    time, frames = path.to(0.3, force=(6.0, 8.0, -8.0)).to(0.4).to(0.3, force=(0, 0, -8.0)).frames(500.0)
    made = CellMotion("insert", time, commands(frames, FOUND.scene, FOUND.config.stiffness))
    return record_cell(MODEL.add(HIDDEN[hidden]), made, NOISE, stream(2, "closed loop"))


@pytest.mark.parametrize("case", HIDDEN)
def test_the_corrected_model_ends_as_the_hidden_cell_and_with_its_peak_force(case):
    rec = insertion(case)
    replayed, said = closed_loop([rec], {"given": World(), "corrected": World().add(HIDDEN[case])})
    assert not said
    trials = replayed[0]["trials"]
    measured, given, corrected = (trials[name] for name in ("measured", "given", "corrected"))
    assert measured["outcome"] == corrected["outcome"] == rec.outcomes[0].category
    assert given["outcome"] == "success"
    assert (measured["outcome"] == "success") == (case == "tilted")
    for key, tick in (("peak_force", 0.0), ("contact_s", 0.004)):  # a contact begins and ends at samples
        assert abs(corrected[key] - measured[key]) <= max(tick, 0.5 * abs(given[key] - measured[key])) + 1e-9
    assert measured["peak_force"] == pytest.approx(corrected["peak_force"], abs=1.0), "noise of the sensor apart"


def test_only_what_can_be_run_again_is():
    """No outcome stated, or no osc: nothing; samples that are not the controller's ticks: a note, and no error."""
    rec = insertion("tilted")
    assert closed_loop([replace(rec, outcomes=())], {}) == ([], [])
    assert closed_loop([replace(rec, control=replace(rec.control, mode="unknown"))], {}) == ([], [])
    keep = np.r_[:700, 705 : len(rec.time)]
    gap = replace(rec, time=rec.time[keep], q=rec.q[keep], ft=rec.ft[keep], ee_cmd=rec.ee_cmd[keep])
    replayed, said = closed_loop([gap], {"given": World()})
    assert not replayed
    assert said == ["not run again in closed loop: simulated: samples are not the controller's ticks; expected 500 Hz"]
