"""Several effects of one joint, of which each alone is refused, are found together; fits of limits start at guesses."""

import numpy as np
import pytest
from loops import pendulum

from vispeg.api.fit import fit
from vispeg.core.effect import EffectInstance, searchable
from vispeg.core.seeds import stream
from vispeg.diagnosis.evidence.starts import with_start_values
from vispeg.diagnosis.proposal import placed, propose
from vispeg.diagnosis.selection.judge import Judge
from vispeg.diagnosis.selection.pairs import pairs
from vispeg.diagnosis.selection.search import Search
from vispeg.identify.evidence import Evidence
from vispeg.identify.excitation import Motion
from vispeg.identify.record import controller, record
from vispeg.recordings.recording import Recording
from vispeg.worlds.world import World

SERVO = EffectInstance.of("servo", "hinge", natural_frequency=40.0, damping_ratio=1.3)
LIMIT = EffectInstance.of("goal_rate_limit", "hinge", rate=1.0)


def strokes(size: float, step: float, seed: int, *effects: EffectInstance) -> Recording:
    """The pendulum under a servo at 50 Hz, on strokes of this size and steps: large ones pass the limit."""
    robot, time = pendulum(), np.arange(200) / 50.0
    goal = size * np.sin(2 * np.pi * (0.7 + 0.1 * seed) * time) + np.where(time % 2 < 1, 0.0, step)
    motion = Motion("strokes", time, goal[:, None], np.gradient(goal, time)[:, None])
    loop = controller(robot, "servo", 50.0, np.zeros(1))
    return record(World(robot.source, None, effects), motion, loop, {"q": 5e-4}, stream(seed, "strokes"))


@pytest.fixture(scope="module")
def search() -> Search:
    """Fitted on large strokes, judged on small ones, in which the limit does nothing."""
    large, small = strokes(0.5, 0.25, 0, SERVO, LIMIT), strokes(0.02, 0.0, 2, SERVO, LIMIT)
    return Search(Evidence([large]), Judge(Evidence([small])))


@pytest.mark.slow
def test_a_servo_and_a_limit_are_found_together_where_nothing_passes_alone(search):
    """The limit alone gains nothing on small strokes, and the servo alone takes the limit for its own slowness."""
    state = search.start(World(pendulum().source))
    best, *others = search.offers(state)
    alone = [t for t in others if not t.score.beside]
    assert {"servo", "goal_rate_limit"} <= {t.score.placed.effect for t in alone} and all(t.rejected for t in alone)
    assert not best.rejected and {e.effect for e in best.score.members} == {"servo", "goal_rate_limit"}
    assert best.score.label.endswith("(hinge)") and search.judge.mean(best.loss) < 1.2
    found = {e.effect: e for e in best.fit.world.effects}
    for truth in (SERVO, LIMIT):
        for name, v in truth.params.items():
            assert found[truth.effect].params[name].value == pytest.approx(v.value, rel=0.05)


def test_a_pair_promises_what_a_rollout_at_its_guesses_removes(search):
    state = search.start(World(pendulum().source))
    found = pairs(search, state, search.missing(state.world))
    assert [s.gain for s in found] == sorted((s.gain for s in found), reverse=True) and found[0].gain > 0
    starts = [[(e.effect, *(v.value for v in e.params.values())) for e in s.members] for s in found]
    assert len({str(s) for s in starts}) == len(starts), "each start once"
    for score in found[:3]:
        a, b = (searchable()[e.effect] for e in score.members)
        assert a.distant and b.distant and not (a.overrides("drive") and b.overrides("drive"))
        (after,) = search.evidence.residuals([state.world.add(*score.members)])
        assert score.gain == pytest.approx(state.residual @ state.residual - after @ after)


def test_a_fit_without_a_start_value_begins_where_it_has_a_slope(search):
    recordings = search.evidence.recordings[:1]
    world = World(pendulum().source).add(SERVO, EffectInstance.of("goal_rate_limit", "hinge"))
    started = with_start_values(search.evidence, world, [1]).effects[1].params["rate"].value
    assert started < 10.0 and with_start_values(search.evidence, world, []) == world
    robot = World(pendulum().source).add(SERVO)
    out = fit(robot, recordings, ["goal_rate_limit:hinge"], method="least-squares", threads=1)
    assert out.effects[0].params["rate"].value == pytest.approx(1.0, rel=0.02)
    named = fit(robot, recordings, [LIMIT], method="least-squares", iterations=1, threads=1)
    assert named.effects[0].params["rate"].value == pytest.approx(1.0, rel=0.1)


def test_a_stated_start_value_stays_where_the_effect_is_named_twice_or_is_in_the_model(search):
    """One point takes no step, so the fitted value is the start."""
    recordings, arm = search.evidence.recordings[:1], World(pendulum().source).add(SERVO)
    null = EffectInstance.of("goal_rate_limit", "hinge")
    options = {"method": "least-squares", "iterations": 1, "threads": 1}
    for world, effects, start in (
        (arm, ["goal_rate_limit:hinge", "goal_rate_limit:hinge:rate=5"], 5.0),
        (arm, ["goal_rate_limit:hinge", EffectInstance.of("goal_rate_limit", "hinge", rate=5.0)], 5.0),
        (arm.add(LIMIT), [null], null.params["rate"].value),
    ):
        found = fit(world, recordings, effects, **options)
        assert found.effects[0].params["rate"].value == pytest.approx(start)


EVERY_ARM_HAS = (
    EffectInstance.of("viscous_friction", "hinge", damping=0.3),
    EffectInstance.of("rotor_inertia", "hinge", inertia=0.05),
    EffectInstance.of("joint_bias", "hinge", torque=-0.4),
)


def test_what_every_arm_has_is_found_together_in_a_joint_that_torques_alone_drive():
    """Far from the measurement no effect gains anything alone: the set that the torques propose is found."""
    robot, time, motions = pendulum(), np.arange(300) / 100.0, []
    for k in range(2):
        goal = 0.6 * np.sin(2 * np.pi * (0.6 + 0.3 * k) * time)
        motion = Motion("sine", time, goal[:, None], np.gradient(goal, time)[:, None])
        world, loop = World(robot.source, None, EVERY_ARM_HAS), controller(robot, "torque", 100.0, np.zeros(1))
        motions.append(record(world, motion, loop, {"q": 1e-4, "dq": 1e-3}, stream(k, "sine")))
    world = World(robot.source)
    proposal = propose(world, motions[:1], motions[1:])
    search = Search(Evidence(motions[:1]), Judge(Evidence(motions[1:])), proposed=lambda: placed(proposal))
    found = {e.effect: e for e in search.run(world).world.effects}
    assert set(found) == {e.effect for e in EVERY_ARM_HAS}
    for truth in EVERY_ARM_HAS:
        for name, v in truth.params.items():
            assert found[truth.effect].params[name].value == pytest.approx(v.value, rel=0.01)
