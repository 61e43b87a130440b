"""An arm that touches: a nominal one is adequate, and what its joints hide is still seen."""

from dataclasses import replace

import numpy as np
import pytest

from vispeg.api.recording.record import record
from vispeg.core.effect import EffectInstance
from vispeg.core.errors import UserError
from vispeg.core.rules import RULES
from vispeg.diagnosis.run import diagnose
from vispeg.identify.contact import contact_of
from vispeg.identify.evidence import Evidence
from vispeg.identify.inverse import TorqueEvidence
from vispeg.identify.nominal import robot_of
from vispeg.recordings.recording import Control
from vispeg.worlds.model_file import load_model
from vispeg.worlds.world import World

CELL = load_model("peg-cell")
FRICTION = EffectInstance.of("coulomb_friction", "joint4", torque=1.0)
ARM = World("iiwa14")


def pressed(seed, *effects, motion="press"):
    return record(CELL.add(*effects), motion, seed=seed, name=f"{motion}-{seed}").recording


@pytest.fixture(scope="module")
def nominal():
    return pressed(1)


def times_floor(evidence, *effects):
    return evidence.rms_error(evidence.residuals([World(effects=effects)])[0]) / evidence.floor


def test_a_nominal_arm_that_presses_its_peg_is_adequate(nominal):
    """Without the measured force in the model, the same recording is hundreds of floors away."""
    evidence = Evidence([nominal])
    assert times_floor(evidence) < 1.2
    assert np.sum(evidence.residuals([ARM])[0] ** 2) / evidence.count < 1.3
    assert any("the tool touches" in note and "left out" in note for note in evidence.notes)
    assert times_floor(Evidence([replace(nominal, wrench=None)])) > 100


@pytest.mark.slow
def test_an_arm_that_touches_still_shows_its_friction():
    evidence = Evidence([pressed(1, FRICTION)])
    assert times_floor(evidence) > 20 * times_floor(evidence, FRICTION)
    assert times_floor(evidence, FRICTION) < 1.5


@pytest.mark.slow
def test_an_arm_in_free_air_is_compared_as_without_a_sensor():
    rec = pressed(0, motion="free")
    assert contact_of(rec, robot_of(rec)) is None
    with_sensor, without = (Evidence([r]).residuals([ARM])[0] for r in (rec, replace(rec, wrench=None)))
    assert np.array_equal(with_sensor, without)


def test_what_is_left_out_is_the_contact_and_a_margin(nominal):
    found = contact_of(nominal, robot_of(nominal))
    acts = np.abs(found.torque).max(axis=1) > 0
    assert found.free[nominal.time < 1.0].all() and not found.free[acts].any()
    out, on = nominal.time[~found.free], nominal.time[acts]
    near = np.abs(out[:, None] - on[None, :: max(1, len(on) // 2000)]).min(axis=1)
    assert near.max() <= RULES.touch_after + 0.02
    assert 0.3 < found.free.mean() < 0.9


def test_torques_by_inverse_dynamics_leave_contact_out_too(nominal):
    unknown = replace(nominal, control=Control("unknown", 500.0), ee_cmd=None)
    seen, blind = TorqueEvidence([unknown]), TorqueEvidence([replace(unknown, wrench=None)])
    errors = [np.sum(e.residuals([ARM])[0] ** 2) / e.count for e in (seen, blind)]
    assert errors[0] < 0.2 * errors[1]
    assert seen.items[0].valid.sum() < blind.items[0].valid.sum()


def cut(rec, *spans):
    """Return these spans (s) of a recording, end to end, with a tool that presses after half a second."""
    rows = np.concatenate([np.flatnonzero((rec.time > start) & (rec.time < end)) for start, end in spans])
    columns = {k: getattr(rec, k)[rows] for k in ("q", "dq", "tau", "ee", "ee_cmd", "ft")}
    columns["ft"] = columns["ft"] + np.where(np.arange(len(rows))[:, None] > 250, [0, 0, -20.0, 0, 0, 0], 0.0)
    return replace(rec, time=np.arange(len(rows)) / 500.0, **columns)


def test_an_arm_that_touches_all_the_time_is_refused(nominal):
    """Half a second in the air, then pressed for good: nothing of the joints can be told, and that is said."""
    pressing = cut(nominal, (-1.0, 0.5), (2.6, 4.2), (2.6, 4.2))
    with pytest.raises(UserError, match="touches something all the time"):
        Evidence([pressing])
    with pytest.raises(UserError, match="touches something all the time"):
        TorqueEvidence([replace(pressing, control=Control("unknown", 500.0), ee_cmd=None)])


def test_an_arm_that_touches_for_too_short_a_time_is_told_so(nominal):
    pressing = cut(nominal, (-1.0, 0.5), (2.6, 4.2))  # 2.1 s, of which the start takes 1.2 s
    with pytest.raises(UserError, match="too short to compare: every episode lasts under 2.4 s"):
        Evidence([pressing])


def test_missing_readings_are_not_called_a_short_recording(nominal):
    blank = replace(nominal, control=Control("unknown", 500.0), ee_cmd=None, wrench=None)
    with pytest.raises(UserError, match="no torque is read"):
        TorqueEvidence([replace(blank, tau=np.full_like(nominal.tau, np.nan))], np.ones(7))


@pytest.mark.slow
def test_the_diagnosis_of_a_nominal_arm_in_contact_names_nothing():
    record = diagnose(ARM, [pressed(1), pressed(2)], [pressed(3)], seed=0).record
    assert record["verdict"] == "adequate" and record["effects"] == []
