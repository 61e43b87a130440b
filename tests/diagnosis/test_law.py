"""A richer law of friction comes in for all joints at once, where it is, and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest
from fits import still
from loops import arm, drive, recorded

from vispeg.core.effect import EffectInstance
from vispeg.core.seeds import stream
from vispeg.diagnosis.selection.judge import Judge
from vispeg.diagnosis.selection.law import laws, refined
from vispeg.diagnosis.selection.search import Search
from vispeg.effects.common.presliding import yielding
from vispeg.identify.evidence import Evidence
from vispeg.identify.inverse import MOTION_HZ, STICK, TorqueEvidence
from vispeg.recordings.differentiate import smooth
from vispeg.recordings.recording import Control
from vispeg.worlds.world import World

LEVEL = np.array([0.6, 0.25])  # N m
STIFFNESS = {"shoulder": 120.0, "elbow": 60.0}  # N m/rad: it slips after 5 and 4 mrad
JOINTS = ("shoulder", "elbow")


@pytest.fixture(scope="module", params=[("shoulder", "elbow"), ("shoulder",), ()])
def searched(request):
    """(joints that preslide, a search, its state with Coulomb friction fitted in both joints)."""
    robot, recordings = arm(), []
    for i in range(3):
        t = np.arange(1600) * 5e-3
        swing = 1 - np.cos(2 * np.pi * np.outer(t, [0.7 + 0.2 * i, 1.1 - 0.2 * i]))
        s = drive(robot, "position", 0.0, command=0.2 * swing, seconds=8.0, rate=200.0, kp=60.0, kd=4.0)
        rec = recorded(robot, robot.source, World(), s, stream(5, i), tau_noise=0.02)
        motion, dq, _ = smooth(rec.time, rec.q, MOTION_HZ)
        dry = LEVEL * np.tanh(dq / STICK)
        for j, joint in enumerate(JOINTS):
            if joint in request.param:
                dry[:, j] = STIFFNESS[joint] * yielding(motion[:, j], LEVEL[j] / STIFFNESS[joint])
        tau = rec.tau + dry
        unknown = Control("unknown", rec.rate_hz)
        recordings.append(replace(rec, control=unknown, tau=tau, torque_sensor="motor", q_cmd=None, dq_cmd=None))
    search = Search(TorqueEvidence(recordings[:2]), Judge(TorqueEvidence(recordings[2:])))
    friction = [EffectInstance.of("coulomb_friction", joint, torque=0.4) for joint in JOINTS]
    return request.param, search, search.start(World(robot.source).add(*friction), 0)


def test_presliding_takes_the_place_of_dry_friction_in_the_joints_that_show_it(searched):
    preslides, search, state = searched
    before = search.judge.mean(state.loss)
    assert refined(search, state) == bool(preslides)
    named = {(e.effect, e.where): e for e in state.world.effects}
    assert set(named) == {("hysteresis" if j in preslides else "coulomb_friction", j) for j in JOINTS}
    assert not preslides or search.judge.mean(state.loss) < 0.7 * before
    for j, joint in enumerate(JOINTS):
        if joint in preslides:
            p = named["hysteresis", joint].params
            assert p["torque"].value == pytest.approx(LEVEL[j], rel=0.05)
            assert p["stiffness"].low < STIFFNESS[joint] * 1.1 and p["stiffness"].high > STIFFNESS[joint] * 0.9
    assert not refined(search, state), "a second time there is nothing to gain"


def test_a_law_is_asked_where_it_has_the_magnitudes_of_the_simple_one_and_is_not_there_yet():
    evidence = Evidence([still(arm())])
    search = Search(evidence, Judge(evidence))
    friction = [EffectInstance.of("coulomb_friction", joint, torque=0.4) for joint in JOINTS]
    asked = [(len(simple), kind.name) for simple, kind in laws(search, World().add(*friction), 0)]
    assert asked == [(2, "hysteresis")], "Stribeck's law has two levels, and no start follows from one"
    assert not [*laws(search, World().add(*friction), 1)], "one joint alone is a matter of an effect"
    there = World().add(*friction, EffectInstance.of("hysteresis", "elbow"))
    assert not [*laws(search, there, 0)]
