"""What to record next: something that would settle a question, or nothing."""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import fits
import numpy as np
import pytest
from loops import pendulum

from vispeg.core.effect import EffectInstance
from vispeg.core.rules import RULES
from vispeg.diagnosis.conclusion.next_experiment import MENU, _Menu, next_experiment
from vispeg.diagnosis.findings import Gain, Rivals, Score, Trial
from vispeg.diagnosis.selection.judge import Judge
from vispeg.diagnosis.selection.search import Search
from vispeg.diagnosis.selection.state import State
from vispeg.identify.evidence import Evidence
from vispeg.identify.inverse import TorqueEvidence
from vispeg.identify.record import controller
from vispeg.recordings.cell import WrenchSensor
from vispeg.recordings.recording import Control, Recording
from vispeg.robots.model import load
from vispeg.worlds.world import World

CHOSEN, OTHER = (
    EffectInstance.of("coulomb_friction", "joint4", torque=1.2),
    EffectInstance.of("viscous_friction", "joint4", damping=2.0),
)


def trial(placed):
    return Trial(Score(placed, 1.0), fits.fit(World("iiwa14").add(placed)), np.ones((3, 1)), Gain(0.0, 0.0, 0.0))


@lru_cache
def search():
    robot = load("iiwa14")
    rec = fits.still(robot, 1.0, control=controller(robot, "position", 100.0, np.zeros(7)))
    evidence = Evidence([replace(rec, robot="iiwa14")])
    return Search(evidence, Judge(evidence))


@lru_cache
def torques(sigma=0.5):
    """The same where torques were measured and no controller is known."""
    robot, q = load("iiwa14"), np.zeros((1000, 7))
    control = Control("unknown", 100.0)
    rec = Recording(Path("torques"), "iiwa14", robot.joints, 100.0, control, np.arange(1000) / 100.0, q, tau=q)
    evidence = TorqueEvidence([replace(rec, torque_sensor="motor", noise={"tau": sigma})])
    return Search(evidence, Judge(evidence))


STATE = State(World("iiwa14").add(CHOSEN), np.ones((3, 1)), np.zeros(1), 0)
REFUSED = [Rivals(CHOSEN.label, (), (trial(OTHER),))]
EQUAL = [Rivals(CHOSEN.label, (trial(OTHER),), (trial(OTHER),))]


def test_two_models_are_as_far_apart_as_at_the_step_that_the_stiffer_one_needs():
    """Gear play takes a millisecond; at two its motion is another."""
    play = {"gap": 1e-3, "motor_inertia": 0.01, "compliance": 5e-6}
    stiff = World().add(EffectInstance.of("backlash", "hinge", **play))
    distances = []
    for h_max in (2e-3, 1e-3):
        evidence = Evidence([fits.still(pendulum(), 1.0)], h_max=h_max)
        menu = _Menu(Search(evidence, Judge(evidence)), 0)
        menu.motions = {"chirp": menu.motions["chirp"]}
        distances.append(menu.apart(World(), stiff)["chirp"][0])
    assert distances[0] == distances[1] > 0


@pytest.mark.parametrize("made", [search, torques])
def test_a_model_without_a_rival_asks_for_nothing(made):
    """A refused candidate is none: what separates it was seen already."""
    assert next_experiment(made(), STATE, REFUSED, "identified", 0) == (None, {})
    assert next_experiment(made(), STATE, [], "adequate", 0) == (None, {})


def test_rivals_are_separated_by_the_motion_that_separates_them_most():
    found, arrays = next_experiment(search(), STATE, EQUAL, "ambiguous", 0)
    assert found["motion"] in MENU and found["expected_separation_sigma"] > 100 * RULES.next_sigma
    assert "coulomb_friction(joint4) from viscous_friction(joint4)" in found["why"]
    apart = (arrays["next/A"] - arrays["next/B"]) / search().evidence.items[0].sigma
    assert np.sqrt(np.sum(apart**2)) == pytest.approx(found["expected_separation_sigma"], rel=1e-3)


def test_what_no_motion_separates_is_said_and_no_motion_is_drawn():
    """Predictions that differ by rounding alone are no experiment."""
    same = EffectInstance.of("coulomb_friction", "joint4", torque=1.2 + 1e-9)
    found, arrays = next_experiment(search(), STATE, [Rivals(CHOSEN.label, (trial(same),), ())], "ambiguous", 0)
    assert found["motion"] == "" and "no motion of the menu" in found["why"] and not arrays
    assert found["expected_separation_sigma"] < RULES.next_sigma and "file" not in found


def test_what_nothing_explains_is_shown_apart_by_a_motion_that_can_be_played():
    found, arrays = next_experiment(search(), STATE, REFUSED, "unexplained", 0)
    assert found["motion"] == "triangle" and found["file"] and arrays["next/q_cmd"].shape[1] == 7
    assert "expected_separation_sigma" not in found, "no two predictions, no distance"


def test_torques_of_rivals_are_separated_too():
    """Coulomb and viscous friction of joint 4 along a motion: the distance is that of the two friction torques."""
    found, arrays = next_experiment(torques(), STATE, EQUAL, "ambiguous", 0)
    assert found["motion"] in MENU and found["expected_separation_sigma"] > RULES.next_sigma and found["file"]
    gap = (arrays["next/A"] - arrays["next/B"])[::2, 3]  # compared at 50 Hz
    assert arrays["next/A"].shape == arrays["next/q_cmd"].shape
    assert np.abs(np.delete(arrays["next/A"] - arrays["next/B"], 3, axis=1)).max() < 1e-9
    assert np.sqrt(np.sum((gap / 0.5) ** 2)) == pytest.approx(
        found["expected_separation_sigma"], rel=0.2
    )  # less the ends
    found, arrays = next_experiment(torques(), STATE, REFUSED, "unexplained", 0)
    assert found["motion"] == "triangle" and "gains stated" in found["why"] and arrays["next/q_cmd"].shape[1] == 7


def test_a_wrist_wrench_changes_no_torque_of_the_menu():
    """The menu's motions are in free air and of another length than the recorded wrench."""
    made = torques()
    (rec,) = made.evidence.recordings
    ft = np.tile([0.0, 0.0, -20.0, 0.0, 0.0, 0.0], (len(rec.time), 1))  # N, N m, from the first sample on: a rest
    evidence = TorqueEvidence([replace(rec, ft=ft, wrench=WrenchSensor(tared=True))])
    found, arrays = next_experiment(Search(evidence, Judge(evidence)), STATE, EQUAL, "ambiguous", 0)
    plain, expected = next_experiment(made, STATE, EQUAL, "ambiguous", 0)
    assert found == plain
    np.testing.assert_array_equal(arrays["next/A"], expected["next/A"])


def test_no_motion_is_asked_for_that_was_recorded():
    """What is unexplained asks for one motion after the other, and in the end for none of the menu."""
    asked = set()
    for _ in MENU:
        found, arrays = next_experiment(search(), STATE, REFUSED, "unexplained", 0, asked)
        assert found["motion"] in MENU and found["motion"] not in asked and "next/q_cmd" in arrays
        asked.add(found["motion"])
    found, arrays = next_experiment(search(), STATE, REFUSED, "unexplained", 0, asked)
    assert found["motion"] == "" and "another arm posture" in found["why"] and not arrays
    best = next_experiment(search(), STATE, EQUAL, "ambiguous", 0)[0]["motion"]
    other = next_experiment(search(), STATE, EQUAL, "ambiguous", 0, {best})[0]
    assert other["motion"] != best and other["expected_separation_sigma"] >= RULES.next_sigma
