"""An arm that gives way behind its encoders: in the plant, in the evidence on contact, and told from a soft fixture."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vispeg.contact.items import driven
from vispeg.contact.run import evidence_of
from vispeg.contact.yielding import arm_displacement
from vispeg.core.effect import EffectInstance, effect
from vispeg.core.errors import UserError
from vispeg.core.rules import RULES
from vispeg.core.seeds import stream
from vispeg.recordings.cell import CellBelief
from vispeg.recordings.noise import NOISE
from vispeg.robots.tools import CELL
from vispeg.sim.compiled import flange_pose
from vispeg.sim.external import flange_jacobian
from vispeg.task.belief import believed
from vispeg.task.rig import table
from vispeg.task.rig.commanded import CellMotion
from vispeg.task.rig.motions import NEAR, Place, motion
from vispeg.task.rig.path import commands
from vispeg.task.rig.posture import elbow_turned, posture
from vispeg.task.rig.record import record_cell
from vispeg.worlds.world import World

MODEL = World("iiwa14", CELL, cell=CellBelief("nominal"))
FOUND = believed(MODEL.cell)
SCENE, PLACE = FOUND.scene, Place(FOUND.scene, stream(1, "gives way"))
ARM = EffectInstance.of("arm_compliance", "all", compliance=7e-5)
CHANCE = RULES.contact_correlated * RULES.interval  # of the squared residual, which a wrong model may gain


def pressed(hidden, x, z, near=None, watch=lambda true: None):
    """3 s of a press with 25 N at one place whose height over the mouth is z."""
    path = PLACE.begin().to(0.5, tip=(x, 0.0, 0.03)).to(0.5, tip=(x, 0.0, z + NEAR))
    path.to(0.3, tip=(x, 0.0, z), force=(0, 0, -3.0)).to(0.5, force=(0, 0, -25.0)).to(0.2)
    time, frames = path.frames(500.0)
    made = CellMotion("press", time, commands(frames, SCENE, FOUND.config.stiffness, near), 40.0, posture=near)
    return record_cell(MODEL.add(*hidden), made, NOISE, stream(2, "gives way"), watch=watch)


@pytest.fixture(scope="module")
def soft():
    """Presses of an arm that gives way: on the fixture, again there with the elbow turned, and on the table."""
    height, far = -float(SCENE.target[2]), SCENE.config.block + 0.06
    true = []
    first = pressed([ARM], PLACE.aside, 0.0, watch=true.append)
    turned = pressed([ARM], PLACE.aside, 0.0, elbow_turned(SCENE))
    return first, turned, pressed([ARM], -far, height), true[0]


def test_encoders_stand_before_the_links_by_compliance_times_the_load(soft):
    rec, _, _, true = soft
    load = rec.tau - rec.tau[:50].mean(axis=0)
    still = (rec.time < 0.45) | (rec.time > rec.time[-1] - 0.1)
    np.testing.assert_allclose((rec.q - true)[still], 7e-5 * load[still], atol=2e-4)
    assert np.abs((rec.q - true)[-50:]).mean(axis=0).max() > 5e-4, "and that is more than noise"


def squares(recs):
    """Squared residual of each recording: of the nominal cell, of the true arm, of a soft fixture of the best size."""
    fixed = [EffectInstance.of("fixture_compliance", "fixture", z=z) for z in (1e-5, 2e-5, 3e-5, 4e-5)]
    worlds = [World(), World().add(ARM), *(World().add(e) for e in fixed)]
    out = []
    for rec in recs:
        found = np.array([r @ r for r in evidence_of([rec]).residuals(worlds)])
        out.append(found)
    return np.array(out)


@pytest.mark.slow
def test_the_true_arm_is_at_the_floor_and_a_press_on_the_table_tells_it_from_the_fixture(soft):
    """A soft fixture takes up most of what a soft arm leaves in a press on it; in a press beside it, nothing.

    Beside it, no compliance changes anything. A fixture without springs is another model to MuJoCo, and rounding alone
    (1e-13 rad on the angles) moves the squared residual of the sticking peg by 1 of 147.
    """
    first, turned, beside, _ = soft
    count = evidence_of([first]).count
    found = squares([first, turned, beside])
    nominal, arm, fixture = found[:, 0], found[:, 1], found[:, 2:]
    assert np.all(arm < 0.5 * count), "the right model is within the floor"
    taken_up = (nominal[:, None] - fixture) / (nominal - arm)[:, None]
    assert nominal[0] - arm[0] > CHANCE and taken_up[0].max() > 0.5
    assert np.ptp(fixture[2]) < 1e-6 and np.abs(nominal[2] - fixture[2]).max() < 0.1 * CHANCE
    apart = [fixture[list(some)].sum(axis=0).min() - arm[list(some)].sum() for some in ((0,), (0, 1), (0, 2))]
    assert apart[0] < apart[1] < apart[2] and apart[2] > max(2 * apart[0], 1.5 * CHANCE)
    assert effect("fixture_compliance").told_from["arm_compliance"] == "touch-datum"


def test_the_zero_of_a_sensor_does_not_move_the_hand(soft):
    """15 N and 1 N m of zero: constant in the flange's axes, but not in the joints' torques along a path."""
    (item,) = evidence_of([soft[0]]).items
    zero = np.repeat([15.0, 1.0], 3)
    other = replace(item, path=replace(item.path, wrench=item.path.wrench + zero))
    raw, shifted = (driven(i, [World().add(ARM)]) for i in (item, other))
    np.testing.assert_allclose(shifted.zero, raw.zero + zero)
    air = slice(0, int(np.argmax(item.phase.near)) * item.phase.size)  # a press that knocks amplifies rounding
    assert np.abs(raw.place[0, air] - item.path.place[air]).max() > 1e-4
    np.testing.assert_allclose(shifted.place[0, air], raw.place[0, air], atol=1e-7)


def test_an_angle_that_was_not_read_does_not_move_the_hand(soft):
    """The displacement is computed from the angles around it, as the path is."""
    (item,) = evidence_of([soft[0]]).items
    worlds = [World().add(ARM)]
    q = soft[0].q.copy()
    q[500:510, 3] = np.nan  # 20 ms of 3 s
    whole, missing = (
        arm_displacement(replace(item, recording=rec), worlds, item.path.wrench[None])
        for rec in (soft[0], replace(soft[0], q=q))
    )
    assert np.abs(whole[0, 0]).max() > 1e-4
    np.testing.assert_allclose(missing[0, 0], whole[0, 0], atol=1e-6)


def test_the_elbow_turns_and_the_flange_stays():
    """Another posture for the same pose, with another compliance; a table of it is the motion."""
    straight, turned = posture(SCENE), elbow_turned(SCENE)
    first, second = (flange_pose(SCENE.nominal, q[None]) for q in (straight, turned))
    np.testing.assert_allclose(first, second, atol=1e-6)
    before, after = (jac @ jac.T for jac in flange_jacobian(SCENE.nominal, np.array([straight, turned])))
    assert np.linalg.norm(after - before) > 0.2 * np.linalg.norm(before)
    low, high = SCENE.range.T
    assert np.all((turned > low + 0.29) & (turned < high - 0.29))


def test_a_table_keeps_the_posture(tmp_path):
    made = motion("press-elbow", SCENE, FOUND.config, 50.0, stream(1, "table"))
    file = tmp_path / "press.csv"
    file.write_text(table.text(made, SCENE.joints))
    read = table.read(file, SCENE.joints, 50.0)
    assert read.posture is not None
    np.testing.assert_allclose(read.posture, elbow_turned(SCENE), atol=1e-8)
    np.testing.assert_allclose(read.ee_cmd, made.ee_cmd, atol=1e-8)
    lines = file.read_text().splitlines()
    file.write_text("\n".join([*lines[:-1], lines[-1].rpartition(",")[0] + ",0.5"]))
    with pytest.raises(UserError, match="one posture for all rows"):
        table.read(file, SCENE.joints, 50.0)
