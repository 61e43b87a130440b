"""The experiment that a class names separates it: signatures that one motion cannot tell apart, the other does."""

from __future__ import annotations

import numpy as np
import pytest

from vispeg.contact.next_motion import apart
from vispeg.contact.run import diagnose_contact, evidence_of
from vispeg.core.effect import EffectInstance
from vispeg.core.seeds import stream
from vispeg.recordings.cell import CellBelief
from vispeg.recordings.noise import NOISE
from vispeg.robots.tools import CELL
from vispeg.task.belief import believed
from vispeg.task.rig.commanded import CellMotion
from vispeg.task.rig.motions import NEAR, Place
from vispeg.task.rig.path import commands, quarter
from vispeg.task.rig.record import record_cell
from vispeg.worlds.world import World

MODEL = World("iiwa14", CELL, cell=CellBelief("nominal"))
FOUND = believed(MODEL.cell)
PLACE = Place(FOUND.scene, stream(1, "separating"))


def recorded(path, hidden=(), seed=2):
    time, frames = path.frames(500.0)
    made = CellMotion("short", time, commands(frames, FOUND.scene, FOUND.config.stiffness))
    return record_cell(MODEL.add(*hidden), made, NOISE, stream(seed, "separating"), name=f"short-{seed}")


def down(x, y, z):
    """A press of 12 N at one place whose height over the mouth is z: as `press` and `touch-datum` make it."""
    path = PLACE.begin().to(0.5, tip=(x, y, 0.03)).to(0.5, tip=(x, y, z + NEAR))
    return path.to(0.5, tip=(x, y, z), force=(0, 0, -5.0)).to(0.4, force=(0, 0, -12.0)).to(0.3)


def against_walls(yaw):
    """Into the hole and against its wall on four sides, the flange turned: as `insert` and `insert-turned` make it."""
    path = PLACE.begin()
    if yaw:
        path.to(0.8, yaw=yaw)
    path.to(0.4, tip=(0, 0, 0.004)).to(0.7, tip=(0, 0, -0.5 * PLACE.depth))
    for push in ((8.0, 0, 0), (0, 8.0, 0), (-8.0, 0, 0), (0, -8.0, 0)):
        path.to(0.3, force=push).to(0.1)
    return path


HEIGHT, FAR = -float(FOUND.scene.target[2]), FOUND.scene.config.block + 0.06
PAIRS = {  # two placed effects whose sizes do the same to one motion, and the motion that tells them apart
    "height": (("hole_offset", "fixture", {"z": 1e-3}), ("grip_pose", "peg", {"z": 1e-3}), "touch-datum"),
    "place": (("hole_offset", "fixture", {"x": 1.5e-3}), ("grip_pose", "peg", {"x": -1.5e-3}), "insert-turned"),
}


def cosines(recordings, effects):
    """Of what two effects change in the wrench over its floor: in the first recording, and in all of them."""
    evidence = evidence_of(recordings)
    worlds = [World(), *(World().add(EffectInstance.of(name, at, **p)) for name, at, p in effects)]
    found = [
        [((p - values[0]) / item.sigma)[item.valid] for p in values[1:]]
        for item, values in zip(evidence.items, evidence.simulated(worlds), strict=True)
    ]
    return cosine(found[:1]), cosine(found)


def cosine(parts):
    u, v = (np.concatenate([p[k] for p in parts]) for k in (0, 1))
    return float(u @ v / np.linalg.norm(u) / np.linalg.norm(v))


def motions(case):
    """The motion that cannot tell a pair apart, and the one that does."""
    if case == "height":
        return down(PLACE.aside, 0.0, 0.0), down(-FAR, 0.0, HEIGHT)
    return against_walls(0.0), against_walls(quarter(FOUND.scene))


@pytest.mark.slow
@pytest.mark.parametrize("case", PAIRS)
def test_the_named_experiment_separates_what_one_motion_cannot(case):
    """One class by a single motion (cosine of signatures above 0.97), below 0.9 with the one that a verdict names."""
    a, b, motion = PAIRS[case]
    asked = [apart(EffectInstance.of(name, at, **size), other[0])[0] for (name, at, size), other in ((a, b), (b, a))]
    assert asked == [motion, motion]
    alone, together = cosines([recorded(path) for path in motions(case)], (a, b))
    assert abs(alone) > 0.97 and abs(together) < 0.9


def presses(z, *places):
    """The same at some places (x, y), one after the other, over a surface whose height over the mouth is z."""
    path = PLACE.begin()
    for x, y in places:
        path.to(0.5, tip=(x, y, 0.02)).to(0.5, tip=(x, y, z + NEAR)).to(0.4, tip=(x, y, z), force=(0, 0, -5.0))
        path.to(0.3, force=(0, 0, -15.0)).to(0.2).to(0.5, tip=(x, y, 0.02), force=(0, 0, 0))
    return path


def recordings(case, hidden, seed):
    """The motion that cannot tell a pair apart, and the one that does, as a diagnosis needs them."""
    if case == "place":
        return [recorded(path, hidden, seed) for path in motions(case)]
    r = PLACE.aside
    over = presses(0.0, (r, 0.0), (0.0, r), (-r, 0.0), (0.0, -r))
    return [recorded(path, hidden, seed) for path in (over, presses(HEIGHT, (-FAR, 0.0), (0.0, FAR)))]


@pytest.mark.slow
@pytest.mark.parametrize("case", PAIRS)
def test_a_diagnosis_names_both_of_a_pair_and_one_once_the_experiment_that_it_asks_for_is_recorded(case):
    (name, at, size), (other, _, _), motion = PAIRS[case]
    hidden = (EffectInstance.of(name, at, **size),)
    fitted, judged = (recordings(case, hidden, seed) for seed in (2, 3))
    alone = diagnose_contact(MODEL, fitted[:1], judged[:1], nthread=1)
    ((axis, true),) = size.items()
    (row,) = (r for r in alone.record["shows_from"] if r["effect"] == name)
    assert row["between"][axis][1] < true, "no effect is named that is smaller than what is said to show"
    (found,) = alone.record["effects"]
    pair = {found["effect"], *(e["effect"] for e in found["indistinguishable_from"])}
    assert alone.record["verdict"] == "ambiguous" and {name, other} <= pair
    asked = alone.record["next_experiment"]
    assert asked is not None and asked["motion"] == motion
    both = diagnose_contact(MODEL, fitted, judged, nthread=1)
    (named,) = both.world.effects
    assert both.record["verdict"] == "identified" and (named.effect, named.where) == (name, at)
    assert named.params[axis].value == pytest.approx(true, abs=2e-4), "kinematics are trusted to 0.2 mm"
