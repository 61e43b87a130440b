"""An insertion run again in closed loop: the right model ends as the hidden cell did, and with its peak force."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from vispeg.contact.again.closed_loop import at_ends, closed_loop, contradicted, ended_alike, first_episode
from vispeg.contact.selection.repeats import repeats
from vispeg.core.effect import EffectInstance
from vispeg.core.errors import UserError
from vispeg.core.params import Value
from vispeg.core.seeds import stream
from vispeg.diagnosis.findings import Verdict
from vispeg.recordings.cell import CellBelief
from vispeg.recordings.noise import NOISE
from vispeg.recordings.recording import Signal
from vispeg.robots.tools import CELL
from vispeg.task.belief import believed
from vispeg.task.rig.commanded import CellMotion
from vispeg.task.rig.motions import Place
from vispeg.task.rig.path import commands
from vispeg.task.rig.record import record_cell
from vispeg.task.rig.replay import replay
from vispeg.worlds.world import World

MODEL = World("iiwa14", CELL, cell=CellBelief("nominal"))
FOUND = believed(MODEL.cell)
HIDDEN = {
    "tilted": EffectInstance.of("hole_tilt", "fixture", roll=0.03),
    "too tight": EffectInstance.of("hole_clearance", "fixture", width=-3.4e-3),
    "stiff joint": EffectInstance.of("coulomb_friction", "joint2", torque=4.0),
}


@cache
def insertion(hidden):
    """A short one: in, against the wall on one side, to the bottom."""
    place = Place(FOUND.scene, stream(1, "closed loop"))
    path = place.begin().to(0.5, tip=(0, 0, 0.004)).to(0.8, tip=(0, 0, -0.8 * place.depth), force=(0, 0, -8.0))
    time, frames = path.to(0.3, force=(6.0, 8.0, -8.0)).to(0.4).to(0.3, force=(0, 0, -8.0)).frames(500.0)
    made = CellMotion("insert", time, commands(frames, FOUND.scene, FOUND.config.stiffness))
    return record_cell(MODEL.add(HIDDEN[hidden]), made, NOISE, stream(2, "closed loop"))


@pytest.mark.parametrize("case", ["tilted", "too tight"])
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


def test_only_recordings_that_can_be_replayed_are():
    """No outcome stated, or no osc: nothing; samples that are not the controller's ticks: a note, and no error."""
    rec = insertion("tilted")
    assert closed_loop([replace(rec, outcomes=())], {}) == ([], [])
    assert closed_loop([replace(rec, control=replace(rec.control, mode="unknown"))], {}) == ([], [])
    with pytest.raises(UserError, match="control.mode: cannot be replayed; expected osc; got 'unknown'"):
        replay(replace(rec, control=replace(rec.control, mode="unknown")), [World()])
    with pytest.raises(UserError, match="without commanded flange poses; expected columns ee_cmd"):
        replay(replace(rec, ee_cmd=None), [World()])
    keep = np.r_[:700, 705 : len(rec.time)]
    gap = replace(rec, time=rec.time[keep], q=rec.q[keep], ft=rec.ft[keep], ee_cmd=rec.ee_cmd[keep])
    replayed, said = closed_loop([gap], {"given": World()})
    assert not replayed
    assert said == ["not run again in closed loop: simulated: samples are not the controller's ticks; expected 500 Hz"]


@pytest.mark.filterwarnings("ignore:All-NaN slice")
def test_what_cannot_be_simulated_or_compared_is_a_message_and_no_error():
    """A world that no longer exists, and a wrench without one of its axes: no contact force of it is known."""
    rec, gone = insertion("tilted"), np.array([np.nan, 0, 0, 0, 0, 0])
    nowhere, numb = replace(rec, cell=CellBelief("nowhere")), replace(rec, ft=rec.ft + gone)
    for case, words in ((nowhere, "nowhere"), (numb, "no contact force is finite")):
        replayed, said = closed_loop([case], {"given": World()})
        assert not replayed and len(said) == 1 and words in said[0]


def test_an_episode_is_cut_out_with_all_its_signals():
    rec = insertion("tilted")
    n = len(rec.time)
    current = Signal(np.arange(n)[:, None] * np.ones(len(rec.joints)), "A")
    whole = replace(rec, episode=np.arange(n) // 600, signals={"current": current})
    first = first_episode(whole)
    assert len(first.time) == len(first.q) == len(first.signals["current"].values) == 600


SURE = Verdict("identified", "along the measured path")


@pytest.mark.parametrize("case", HIDDEN)
def test_a_verdict_stays_where_the_model_ends_as_the_insertion_did(case):
    """The right model is never contradicted; the model as given is where the hole ends the trial, and not where the
    arm is off in free air too.
    """
    rec = insertion(case)
    models = {"given": World(), "corrected": World().add(HIDDEN[case])}
    for name, model in models.items():
        replayed, _ = closed_loop([rec], {name: model})
        verdict = contradicted(SURE, replayed, [rec], model, 0, 1)
        arm_is_right = replayed[0]["trials"][name]["free_off"] < repeats()["m"]
        assert arm_is_right == (name == "corrected" or case != "stiff joint")
        if (case, name) != ("too tight", "given"):
            assert verdict is SURE
        else:
            assert (verdict.verdict, verdict.partial) == ("unexplained", True)
            assert "in closed loop" in verdict.reason


def test_an_arm_that_was_never_in_free_air_is_not_known_to_be_right():
    rec = insertion("too tight")
    replayed, _ = closed_loop([rec], {"given": World()})
    for trial in replayed[0]["trials"].values():
        del trial["free_off"]
    assert contradicted(SURE, replayed, [rec], World(), 0, 1) is SURE


@pytest.mark.slow
def test_a_verdict_falls_only_where_no_value_within_the_intervals_comes_near():
    """The same model: sure of a wide hole it is contradicted, unsure of it up to the right width it is not."""
    rec = insertion("too tight")
    wide = EffectInstance.of("hole_clearance", "fixture", width=-1e-5)
    for low, verdict in ((-2e-5, "unexplained"), (-3.4e-3, "identified")):
        model = World().add(replace(wide, params={"width": Value(-1e-5, low, 0.0)}))
        replayed, _ = closed_loop([rec], {"given": World(), "corrected": model})
        assert contradicted(SURE, replayed, [rec], model, 0, 1).verdict == verdict


def test_a_peak_force_within_a_quarter_or_a_newton_or_between_two_runs_is_alike():
    def trial(peak, outcome="success"):
        return {"peak_force": peak, "contact_s": 1.0, "outcome": outcome}

    assert ended_alike(trial(20.0), [trial(24.9)])
    assert not ended_alike(trial(20.0), [trial(25.1)])
    assert ended_alike(trial(1.0), [trial(1.9)])
    assert ended_alike(trial(20.0), [trial(10.0), trial(40.0)])
    assert not ended_alike(trial(20.0), [trial(20.0, "jammed")])
    assert ended_alike(trial(20.0, "timeout"), [trial(20.0, "jammed")]), "why it failed is chance"


def test_each_uncertain_value_is_run_at_both_its_ends():
    given = EffectInstance.of("hole_tilt", "fixture", roll=0.01)
    known = EffectInstance.of("tool_mass", "gripper", mass=0.1)
    unsure = replace(given, params={**given.params, "roll": Value(0.01, 0.0, 0.02)})
    worlds = list(at_ends(World().add(known).add(unsure), 0))
    assert sorted(w.effects[1].params["roll"].value for w in worlds) == [0.0, 0.02]
    assert all(w.effects[0] == known for w in worlds)
    assert list(at_ends(World().add(unsure), 1)) == []
