"""Contact as evidence: the hand's coordinates, nulls, hidden effects, and what cannot leak in from the arm."""

from __future__ import annotations

from dataclasses import replace

import fits
import mujoco
import numpy as np
import pytest
from pressed import SCENE, recorded
from scipy import stats

from vispeg.contact.drive import hands
from vispeg.contact.errors.noise import excess_noise, noise, noise_at_rest
from vispeg.contact.errors.nuisance import Nuisance
from vispeg.contact.hand import AXES, hand
from vispeg.contact.inputs import touching
from vispeg.contact.path import jacobian
from vispeg.contact.run import compare_contact, diagnose_contact, evidence_of
from vispeg.contact.selection.likely import intervals
from vispeg.contact.selection.profile import idle, looked_for, places, probed, strongest, tries
from vispeg.contact.selection.screen import Probe, Screen
from vispeg.contact.selection.search import ContactSearch
from vispeg.core.effect import STAGES, EffectInstance, effect
from vispeg.core.errors import UserError
from vispeg.core.params import Value
from vispeg.core.rules import RULES
from vispeg.core.seeds import stream
from vispeg.diagnosis.conclusion.shares import shares
from vispeg.diagnosis.findings import Score, Trial
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.selection.judge import Judge
from vispeg.diagnosis.selection.state import State
from vispeg.identify.fit import fit_job
from vispeg.identify.pool import run_together
from vispeg.recordings.cell import WrenchSensor
from vispeg.worlds.world import World

SURE = 30.0  # drop of the squared residual of five standard deviations of the floor
FIXTURE = EffectInstance.of("fixture_compliance", "fixture", z=3e-5)
FRICTION = EffectInstance.of("contact_friction", "peg", scale=1.7)  # it sticks: its least is told, and no greatest
COULOMB = EffectInstance.of("coulomb_friction", "joint4", torque=1.0)
SLIPPERY = EffectInstance.of("contact_friction", "peg", scale=0.7)


def upto(rec, seconds):
    n = int(seconds * rec.rate_hz)
    return replace(rec, time=rec.time[:n], q=rec.q[:n], ft=rec.ft[:n])


def chi2(recordings) -> float:
    evidence = evidence_of(recordings)
    (r,) = evidence.residuals([World()])
    return float(r @ r / evidence.count)


def test_the_hand_touches_the_world_s_geoms_as_the_scene_does():
    """Whatever affects contact of a user's table: friction in more directions, a margin, another mixing weight."""

    def changed():
        spec = SCENE.spec()
        for geom in spec.worldbody.geoms:
            geom.condim, geom.margin, geom.gap, geom.solmix = 6, 2e-3, 1e-3, 3.0
            geom.friction, geom.priority = (0.4, 0.01, 0.002), 1
        return spec

    scene = replace(SCENE, build=changed)
    ours, whole = hand(scene).compile(), scene.compile()
    names = [g.name for g in scene.spec().worldbody.geoms if g.contype or g.conaffinity]
    assert names
    for field in ("condim", "margin", "gap", "solmix", "friction", "priority", "solref", "solimp", "size", "pos"):
        for name in names:
            got, expected = (getattr(m.geom(name), field) for m in (ours, whole))
            np.testing.assert_array_equal(got, expected, err_msg=f"{field} of {name}")


def test_the_jacobian_of_the_hand_is_mujoco_s():
    """Power of a wrench: forces of the joints are J' w with the Jacobian of the flange's point."""
    model = hand(SCENE).compile()
    data, rng = mujoco.MjData(model), stream(1, "hand")
    data.qpos[:6] = 0.4 * rng.standard_normal(6)
    mujoco.mj_forward(model, data)
    site = data.site("flange")
    jacp, jacr = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    mujoco.mj_jacSite(model, data, jacp, jacr, model.site("flange").id)
    wrench, turn = rng.standard_normal(6), site.xmat.reshape(3, 3)
    expected = jacp[:, :6].T @ turn @ wrench[:3] + jacr[:, :6].T @ turn @ wrench[3:]
    np.testing.assert_allclose(jacobian(data.qpos[None, 3:6])[0] @ wrench, expected, atol=1e-12)
    assert [model.joint(i).name for i in range(6)] == [f"hand_{a}" for a in AXES]


def test_the_right_model_stands_at_the_floor_and_a_wrong_one_does_not():
    """By the squared residual itself: a drop of 30 is more than five standard deviations of the floor.

    Rounding decides whether a peg that sticks knocks as it is lifted, which triples what one recording tells of
    friction (604 or 1,931); the turned one never knocks (1,010), so that both together tell the more than 1,500.
    """
    right = chi2([recorded()])
    assert right < 1.3
    for effect_, wrong in ((FIXTURE, 50.0), (FRICTION, 1500.0)):
        evidence = evidence_of([recorded((effect_,)), recorded((effect_,), turned=True)])
        before, after = (float(r @ r) for r in evidence.residuals([World(), World().add(effect_)]))
        floor = right * evidence.count
        assert before - after > wrong and after - floor < 0.3 * (before - floor)


def test_what_an_effect_of_contact_explains_is_said_of_each():
    """As of joints: judged without one of two, the other unchanged; together they explain nearly all of the excess."""
    judge, world = Judge(evidence_of([recorded((FIXTURE, FRICTION), 1, True)])), World().add(FIXTURE, FRICTION)
    before, after = (judge.mean(loss) for loss in judge.losses([World(), world]))
    found = shares(judge, world, 0, before, after, floor=1.0)
    assert set(found) == {FIXTURE.label, FRICTION.label}
    for said in found.values():
        assert said["without"] > 1.0 and 0.02 < said["explains"]
    assert sum(said["explains"] for said in found.values()) > 0.5


def test_what_happens_in_the_arm_does_not_leak_into_contact():
    """Joint friction changes the motion and the forces, and leaves the model of contact as right as it was."""
    arm = tuple(EffectInstance.of("coulomb_friction", f"joint{j}", torque=1.5) for j in (2, 4, 6))
    rubbed = recorded(arm)
    assert np.abs(rubbed.q - recorded().q).max() > 1e-3
    assert chi2([upto(rubbed, 1.55)]) < 1.3, "while it presses: where it sticks and slips no two runs are alike"


def test_contacts_of_the_hand_are_as_soft_as_those_of_the_arm():
    """MuJoCo regularizes a contact by the inverse weights of its bodies: at the same force the same depth, to 0.1 %."""
    item = evidence_of([recorded()]).items[0]
    batch = hands(item.armless, item.source.scene, item.path, [World()])
    whole = SCENE.compile()
    for name in ("tool", "peg"):
        hand_, arm = (m.body(name).id for m in (item.armless.compile(), whole))
        np.testing.assert_allclose(batch.expand("body_invweight0")[0, hand_], whole.body_invweight0[arm], rtol=1e-3)


def test_frames_and_signs_of_the_sensor_are_undone():
    """The same wrench read in another frame, as a reaction, about another point, gives the same evidence."""
    rec = recorded()
    quat, pos = np.array([0.8, 0.0, 0.6, 0.0]), np.array([0.0, 0.01, -0.03])
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_quat(quat, scalar_first=True)
    force = turn.inv().apply(rec.ft[:, :3])
    torque = turn.inv().apply(rec.ft[:, 3:] - np.cross(pos, rec.ft[:, :3]))
    sensor = WrenchSensor("flange", "flange", False, tuple(pos), tuple(quat))
    other = replace(rec, ft=-np.concatenate([force, torque], axis=1), wrench=sensor)
    np.testing.assert_allclose(touching(other).wrench, rec.ft, atol=1e-12)


@pytest.mark.parametrize(
    "hidden",
    [FIXTURE, FRICTION, pytest.param(SLIPPERY, marks=pytest.mark.slow)],
    ids=("compliant", "rough", "slippery"),
)
def test_a_fit_finds_what_is_hidden_inside_its_interval(hidden):
    """As a search fits it: from the best size of its profile, without the parameters that gain nothing there."""
    evidence = evidence_of([recorded((hidden,)), recorded((hidden,), 1, True)])
    probes = probed(Screen(evidence, World(), ()), [(hidden.effect, hidden.where)], 30.0)
    evidence.absent = idle(probes)
    start = World().add(strongest(probes)[0].placed)
    (fit,) = run_together([fit_job(evidence, start, [0], iterations=6)], evidence.residuals)
    best = fit.space.at(intervals(evidence, fit)[1])  # a lower residual may be met on the way to the ends
    (fit,) = run_together([fit_job(evidence, best, [0], iterations=2)], evidence.residuals)
    name = "z" if hidden is FIXTURE else "scale"
    got, true = intervals(evidence, fit)[0].effects[0].params[name], hidden.params[name].value
    assert got.low <= true <= got.high
    assert got.value == pytest.approx(true, rel=0.15)


def test_every_effect_that_is_looked_for_says_where_when_and_at_which_sizes():
    for kind in looked_for():
        assert kind.stage in STAGES and kind.sizes and kind.shown_by, kind.name
        assert set(kind.sizes) <= set(kind.params) and "wrench" in kind.channels()
        assert all(kind.params[k].low <= v <= kind.params[k].high for k, values in kind.sizes.items() for v in values)
        assert all(effect(other) for other in kind.told_from)


def test_a_profile_ranks_the_class_first_and_names_what_nothing_excites():
    evidence = evidence_of([recorded((FIXTURE,))])
    asked = [p for p in places(evidence, World()) if effect(p[0]).stage == "compliance"]
    scores = strongest(probed(Screen(evidence, World(), ()), asked, 30.0))
    assert scores[0].key == ("fixture_compliance", "fixture")
    air = evidence_of([upto(recorded(), 0.7)])
    assert all(s.gain == -np.inf for s in strongest(probed(Screen(air, World(), ()), asked, 30.0))), (
        "in free air nothing of contact shows"
    )
    assert len(tries("fixture_compliance", "fixture")) == 15


def test_nuisances_are_whitened_by_the_inverse_root_of_their_covariance():
    """`I - U diag(1 - 1/sqrt(1 + s^2)) U'` is the inverse root of `I + A A'`: whitened draws of it have variance 1."""
    rng = stream(3, "nuisance")
    columns = rng.standard_normal((60, 4)) * [0.5, 2.0, 10.0, 0.01]
    left = Nuisance.of(columns)
    root = np.stack([left.whitened(e.reshape(10, 6)).ravel() for e in np.eye(60)])
    np.testing.assert_allclose(root @ (np.eye(60) + columns @ columns.T) @ root, np.eye(60), atol=3e-3)


def test_a_height_within_the_kinematics_trust_is_no_evidence_and_one_beyond_it_is():
    """Higher by half of what kinematics are good to, a cell stays at the floor; ten times that costs ten times more."""
    rec = recorded()
    evidence = evidence_of([rec])
    heights = [
        World().add(EffectInstance.of("hole_offset", "fixture", z=z))
        for z in (0.0, RULES.kinematics_place / 2, 10 * RULES.kinematics_place)
    ]
    level, within, beyond = (float(r @ r) for r in evidence.residuals(heights))
    assert within < 0.5 * evidence.count and beyond - level > max(10 * SURE, 10 * (within - level))


def test_noise_beyond_what_is_stated_is_heard_at_rest_and_named():
    """Stated 0.1 N: with 0.25 N more in quadrature both halves hear it, without it neither does."""
    rec, rng = recorded(), stream(5, "louder")
    more = np.repeat([0.25, 0.0], 3) * rng.standard_normal((2, *rec.ft.shape))
    plain = evidence_of([rec]).items
    loud = [evidence_of([replace(rec, ft=rec.ft + m)]).items for m in more]
    (placed,) = excess_noise(World(), *loud)
    force = placed.params["force"]
    assert force.low <= 0.25 <= force.high and force.high - force.low < 0.1
    assert placed.params["torque"].value == 0.0
    assert not excess_noise(World(), plain, plain) and not excess_noise(World(), loud[0], plain)
    assert not excess_noise(World().add(placed), *loud), "the model has it"


@pytest.mark.parametrize("pos", [(0.0, 0.0, 0.08), (0.1, 0.0, 0.0), (0.03, -0.05, 0.12)])
def test_noise_as_stated_of_a_sensor_off_the_flange_is_no_excess(pos):
    """The same wrench about the sensor's point, read with white noise as stated there."""
    rec, rng = recorded(), stream(5, "off the flange")
    about = np.concatenate([rec.ft[:, :3], rec.ft[:, 3:] - np.cross(pos, rec.ft[:, :3])], axis=1)
    sigma = np.repeat([0.5, 0.025], 3)
    noise = {**rec.noise, "ft": np.hypot(0.1, 0.5), "ft_torque": np.hypot(0.005, 0.025)}
    halves = [
        evidence_of([replace(rec, ft=ft, noise=noise, wrench=WrenchSensor(pos=pos))]).items
        for ft in about + sigma * rng.standard_normal((2, *about.shape))
    ]
    assert excess_noise(World(), *halves) == ()


def test_the_noise_at_rest_is_as_uncertain_as_it_scatters_over_draws():
    """White noise in 200 recordings of six channels; 1200 estimates know their scatter to 2 %."""
    (item,), rng = evidence_of([recorded()]).items, stream(5, "at rest")
    found = []
    for _ in range(200):
        white = rng.standard_normal(item.source.wrench.shape)
        found.append(noise_at_rest(replace(item, source=replace(item.source, wrench=white))))
    level, error = (np.array(f) for f in zip(*found, strict=True))
    assert level.mean() == pytest.approx(1.0, abs=0.01)
    assert error.mean() == pytest.approx(level.std(), rel=0.08)


@pytest.mark.parametrize(("hz", "stated"), [(500.0, True), (500.0, False), (100.0, False), (47.0, True), (47.0, False)])
def test_noise_of_a_slower_wrench_is_what_block_means_show(hz, stated):
    """White noise at `hz`, interpolated onto the joints' clock; the truth: block means of 10 minutes of it.

    The tolerance is three standard errors of 16 blocks at rest and three axes.
    """
    rec, rng, sigma = recorded(), stream(5, f"slower {hz}"), np.repeat([0.5, 0.025], 3)

    def slow(time):
        at = np.arange(0.0, time[-1] + 1 / hz, 1 / hz)
        return np.stack([np.interp(time, at, s * rng.standard_normal(len(at))) for s in sigma], axis=1)

    size = round(RULES.contact_block * rec.rate_hz)
    truth = slow(np.arange(15000 * size) / rec.rate_hz).reshape(-1, size, 6).mean(axis=1).std(axis=0)
    kept = {"ft": np.hypot(0.1, 0.5), "ft_torque": np.hypot(0.005, 0.025)} if stated else {}
    heard = {k: v for k, v in rec.noise.items() if not k.startswith("ft")} | kept
    item = evidence_of([replace(rec, ft=rec.ft + slow(rec.time), noise=heard)]).items[0]
    found = noise(item)
    if hz == rec.rate_hz:
        np.testing.assert_array_equal(found, np.repeat(list(kept.values()), 3) if stated else noise_at_rest(item)[0])
    for part in (slice(0, 3), slice(3, 6)):
        expected = np.hypot(truth[part], 0.2 * sigma[part] / np.sqrt(size)).mean()
        assert found[part].mean() / np.sqrt(size) == pytest.approx(expected, rel=0.4)
    assert not excess_noise(World(), [item], [item]), "the sensor is as noisy as it was said to be"


def test_friction_of_a_sticking_contact_has_a_low_end_and_a_far_high_end():
    """Peg and fixture stick from a scale of about 1.3 on: more friction changes nothing, no derivative says so."""
    evidence = evidence_of([recorded((FRICTION,))])
    start = World().add(replace(FRICTION, params={"scale": Value(1.5)}))
    (fit,) = run_together([fit_job(evidence, start, [0], iterations=1)], evidence.residuals)
    scale = intervals(evidence, fit)[0].effects[0].params["scale"]
    assert 1.15 < scale.low < 1.45 and scale.high > 2.5


def test_a_size_promises_what_the_best_one_along_its_line_gains():
    rng = stream(3, "promise")
    base, way = rng.standard_normal(200), rng.standard_normal(200)
    way *= -np.sign(base @ way)
    best = float(base @ way) ** 2 / float(way @ way)
    placed = EffectInstance.of("fixture_compliance", "fixture", z=1e-5)
    for size in (0.01, 0.3, 2.0):
        r = base + size * way
        probe = Probe(placed, "z", float(base @ base - r @ r), float(np.sum((r - base) ** 2)))
        assert probe.promise == pytest.approx(best) and probe.gain <= best + 1e-9
        r = base - size * way
        away = Probe(placed, "z", float(base @ base - r @ r), float(np.sum((r - base) ** 2)))
        assert away.promise == away.gain < 0, "it only gets worse"


def test_a_parameter_that_gains_nothing_beside_the_best_of_its_effect_is_idle():
    def probe(name, value, gain):
        return Probe(EffectInstance.of("hole_offset", "fixture", **{name: value}), name, gain)

    probes = [probe("x", 1e-3, 100.0), probe("x", -1e-3, -50.0), probe("y", 1e-3, 10.0), probe("z", 1e-3, -np.inf)]
    assert idle(probes) == {("hole_offset", "z")}
    assert idle([probe("x", 1e-3, -5.0), probe("y", 1e-3, -9.0)]) == {("hole_offset", "y")}


def test_a_comparison_says_axis_and_phase():
    found = compare_contact(World(), [recorded((FIXTURE,))])
    worst = found.record["where_it_fails"][0]
    assert worst["joint"] == "force z" and worst["regime"] == "press"
    assert found.record["joints"][2]["times_floor"] > 2.0
    assert found.arrays["0/measured"].shape == found.arrays["0/before"].shape


def test_a_recording_that_begins_in_contact_or_has_no_wrench_is_refused():
    rec = recorded()
    with pytest.raises(UserError, match="free air"):
        evidence_of([replace(rec, time=rec.time[600:], q=rec.q[600:], ft=rec.ft[600:])])
    with pytest.raises(UserError, match="nor joint torques"):
        evidence_of([replace(rec, ft=None)])


@pytest.mark.slow
def test_both_hidden_effects_are_named_and_none_where_there_is_none():
    both = (FIXTURE, FRICTION)
    fitted = [recorded(both), recorded(both, 1, True)]
    held = [recorded(both, 2), recorded(both, 3, True)]
    found = diagnose_contact(World(), fitted, held)
    named = {e["effect"]: e["params"] for e in found.record["effects"]}
    assert set(named) == {"fixture_compliance", "contact_friction"}
    assert named["fixture_compliance"]["z"]["low"] <= 3e-5 <= named["fixture_compliance"]["z"]["high"]
    assert named["contact_friction"]["scale"]["low"] <= 1.7 <= named["contact_friction"]["scale"]["high"]
    ladder = [rung["heldout_error"] for rung in found.record["ladder"]]
    assert ladder[-1] < 0.5 * ladder[0]
    for e in found.record["effects"]:
        assert ladder[-1] < e["without"] * found.record["noise_floor"]["value"] and 0.0 < e["explains"] < 1.1
    assert [e["effect"] for e in found.record["effects"]] == [e.effect for e in found.world.effects]
    nothing = diagnose_contact(World(), [recorded(), recorded((), 1, True)], [recorded((), 2)])
    assert nothing.record["verdict"] == "adequate" and not nothing.record["effects"]


@pytest.mark.slow
def test_what_was_partial_is_fitted_anew_and_what_acts_on_the_arm_stays():
    """A friction found in part, at 0.6 of the nominal one, is 0.7; a joint's friction is not what a wrench tells."""
    partial = [replace(e, partial=True) for e in (SLIPPERY.with_values(scale=0.6), COULOMB)]
    found = diagnose_contact(World().add(*partial), [recorded((SLIPPERY,))], [recorded((SLIPPERY,), seed=1)], nthread=1)
    (row,) = found.record["effects"]
    assert (row["effect"], found.record["verdict"]) == ("contact_friction", "identified")
    assert 0.6 < row["params"]["scale"]["low"] <= 0.7 <= row["params"]["scale"]["high"]
    assert [e.effect for e in found.world.effects] == ["coulomb_friction", "contact_friction"]
    assert found.world.effects[0] == partial[1] and not found.world.effects[1].partial


def test_nothing_is_fitted_where_nothing_is_hidden():
    """No size of the library gains what chance does not, and a hidden friction gains many times that."""
    for hidden, worth in (((), False), ((FRICTION,), True)):
        evidence = evidence_of([recorded(hidden)])
        search = ContactSearch(evidence, Judge(evidence_of([recorded(hidden, seed=1)])), lambda _: None, Progress())
        best = search.scored(search.start(World(), 0))[0]
        assert (best.gain > search.need()) is worth
        assert not worth or (best.key == ("contact_friction", "peg") and best.gain > 5 * search.need())


def test_what_acts_in_few_held_out_blocks_shows_by_its_size():
    """Three blocks of a recording decide where they differ by much; noise of as many blocks in both ways does not."""
    evidence = evidence_of([recorded()])
    search = ContactSearch(evidence, Judge(evidence), lambda _: None, Progress())
    before = np.where(search.judge.size > 0, 1.0, 0.0)
    few = np.flatnonzero(before[:, 2])[:3]
    before[few, 2] = 15.0
    rng = np.random.default_rng(0)

    fit = fits.fit(World().add(FRICTION))

    def trial(drop: float) -> Trial:
        after = before + np.where(before > 0, rng.normal(0, 0.1, before.shape), 0.0)
        after[few, 2] -= drop
        return Trial(Score(FRICTION, 0.0), fit, after, search.judge.gain(before, after))

    state = State(World(), before, np.zeros(1), 0)
    assert trial(14.0).gain.z < stats.norm.isf(RULES.level)
    assert (
        search.holds(state, trial(14.0))
        and not search.holds(state, trial(1.0))
        and not search.holds(state, trial(-10.0))
    )


def test_a_tared_sensor_reads_nothing_in_free_air():
    """Zeroed once: the constant is unknown, and what is found is the same."""
    raw = recorded((FRICTION,))
    start = np.mean(raw.ft[:100], axis=0)
    tared = replace(raw, ft=raw.ft - start, wrench=WrenchSensor(tared=True))
    given, told = (evidence_of([rec]).residuals([World(), World().add(FRICTION)]) for rec in (raw, tared))
    for a, b in zip(given, told, strict=True):
        # a wrong reading is followed through a slide that sticks and hops: no two are alike to some per cent
        assert np.sqrt(np.mean((a - b) ** 2)) < 0.15 * np.sqrt(np.mean(a**2))
    with pytest.raises(UserError, match="about the tool's weight, 0.0, 0.0, -8.1 N"):
        evidence_of([replace(tared, wrench=WrenchSensor())])
    with pytest.raises(UserError, match="expected nothing"):
        evidence_of([replace(raw, wrench=WrenchSensor(tared=True))])
