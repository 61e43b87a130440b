"""What every effect of kind `contact` promises, measured for each one by walking the registry."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from clamped import SCENE, pose, written
from mujoco import batch as mjb

from vispeg.core.effect import ARM, REGISTRY, EffectInstance, of_family
from vispeg.core.seeds import stream
from vispeg.robots.model import load
from vispeg.sim.compiled import compiled
from vispeg.sim.placement import activate
from vispeg.sim.state import DriveState, Fields
from vispeg.worlds.world import World

EFFECTS = of_family("contact", "task") | {n: e for n, e in REGISTRY.items() if e.family in ARM and not e.searchable}
NAMES = sorted(EFFECTS)
SENSES = ("dropped_readings", "encoder_noise")
WRISTS = [n for n in NAMES if EFFECTS[n].overrides("wrench")]


def placed(name: str, where: str, **values: float) -> World:
    return World().add(EffectInstance.of(name, where, **values))


def starting(name: str) -> dict[str, float]:
    return {k: p.start for k, p in EFFECTS[name].params.items()}


def null(name: str) -> World:
    params = EFFECTS[name].params
    values = {k: 0.5 * (p.start + p.high) if p.shape else p.null for k, p in params.items()}
    return World().add(*(EffectInstance.of(name, where, **values) for where in EFFECTS[name].targets(SCENE)))


def jammed(worlds: list[World], steps: int = 60) -> np.ndarray:
    """States (nsim, nq) of cells let go with the peg against the hole's wall: contact from the first step on."""
    batch, _ = written(worlds)
    batch.expand("opt.timestep")[:] = 1e-3
    batch.bind("qpos")[:, :7] = pose(0.60155, 0.0, 0.035)
    qpos, ncon = batch.bind("qpos"), batch.bind("ncon")
    batch.step()
    assert ncon[0] > 0
    batch.step(nstep=steps - 1)
    return qpos.copy()


def sensed(worlds: list[World], ticks: int) -> np.ndarray:
    """Readings (ticks, nsim, 2, 7) of joints whose angle is the tick and whose velocity is minus that."""
    active, still = activate(SCENE, worlds), np.zeros((len(worlds), 7))
    x = DriveState(1e-3, 1e-3, still, still, still, still, still)
    states = [a.effect.start(x, a.p) for a in active]
    out = []
    for k in range(ticks):
        q = np.full((len(worlds), 7), float(k))
        dq = -q
        for a, state in zip(active, states, strict=True):
            q, dq = a.effect.observe(state, q, dq, x, a.p)
        out.append(np.stack([q, dq], axis=1))
    return np.array(out)


def weighed(worlds: list[World], ticks: int, tick: float = 0.005) -> np.ndarray:
    """Readings (ticks, nsim, 6) of a wrench whose numbers are 1 to 6 times a random walk, the same in every row."""
    walk = np.cumsum(stream(2, "wrench").standard_normal(ticks))
    still = np.zeros((len(worlds), 7))
    x = DriveState(1e-3, tick, still, still, still, still, still)
    active = activate(SCENE, worlds)
    states = [a.effect.start(x, a.p) for a in active]
    out = []
    for level in walk:
        wrench = np.tile(level * np.arange(1.0, 7.0), (len(worlds), 1))
        for a, state in zip(active, states, strict=True):
            wrench = a.effect.wrench(state, wrench, x, a.p)
        out.append(wrench)
    return np.array(out)


@pytest.mark.parametrize("name", NAMES)
def test_no_place_on_an_arm_alone_and_places_of_the_cell(name):
    assert EFFECTS[name].targets(load("iiwa14")) == []
    assert set(EFFECTS[name].targets(SCENE)) <= {*SCENE.parts, *SCENE.joints, "scene", "hole", "flange"}
    assert EFFECTS[name].targets(SCENE)


@pytest.mark.parametrize("name", NAMES)
def test_null_is_bit_identical_to_no_effect(name):
    np.testing.assert_array_equal(*jammed([null(name), World()]))
    if name in SENSES:
        readings = sensed([null(name), World()], 20)
        np.testing.assert_array_equal(readings[:, 0], readings[:, 1])
    if name in WRISTS:
        readings = weighed([null(name), World()], 20)
        np.testing.assert_array_equal(readings[:, 0], readings[:, 1])
    if EFFECTS[name].overrides("believe"):
        (a,) = activate(SCENE, [null(name)])
        goal = stream(1, name).uniform(-1, 1, (1, 3))
        np.testing.assert_array_equal(a.effect.believe(goal, a.p), goal)


@pytest.mark.parametrize("name", NAMES)
def test_only_the_declared_fields_of_its_own_row_and_place_change(name):
    kind, model = EFFECTS[name], compiled(SCENE, [name])
    before = _bytes(model)
    where = kind.targets(SCENE)[0]
    batch = mjb.Batch(model, 3, nthread=1)
    fields = Fields(batch, SCENE)
    for a in activate(SCENE, [World(), placed(name, where, **starting(name)), World()]):
        a.effect.write(fields, a.p)
    assert fields.touched == kind.writes, "asks for what it declares, so that a row can begin anew"
    for field in fields.touched:
        value = batch.expand(field)
        owner = model.opt if field.startswith("opt.") else model
        base = np.asarray(getattr(owner, field.removeprefix("opt."))).reshape(value.shape[1:])
        np.testing.assert_array_equal(value[[0, 2]], np.stack([base, base]), err_msg=field)
        assert not np.array_equal(value[1], base), f"{field} unchanged"
        if field.startswith(("body_", "geom_")):
            moved = [i for i in range(len(base)) if not np.array_equal(value[1, i], base[i])]
            owners = {_body(model, field, i) for i in moved}
            part = {"gripper": "tool", "peg": "peg"}.get(where, "fixture")
            assert owners == {part}
    assert _bytes(model) == before


@pytest.mark.parametrize("name", [n for n in NAMES if EFFECTS[n].writes])
def test_finite_at_every_bound_and_neighbours_untouched(name):
    start = starting(name)
    worlds = [
        placed(name, where, **{**start, k: bound})
        for where in EFFECTS[name].targets(SCENE)
        for k, p in EFFECTS[name].params.items()
        for bound in (p.low, p.high)
    ]
    qpos = jammed([World(), *worlds], steps=30)
    assert np.isfinite(qpos).all()
    np.testing.assert_array_equal(qpos[0], jammed([World(), null(name)], steps=30)[0])


@pytest.mark.parametrize("name", NAMES)
def test_parameters_are_stated_well(name):
    kind = EFFECTS[name]
    assert kind.magnitudes and type(kind).__doc__
    for key, p in kind.params.items():
        assert p.low <= p.null <= p.high or p.shape, key
        assert p.shape or p.start != p.null, key
        assert p.unit and p.doc and (p.scale == "linear" or p.low > 0), key


@pytest.mark.parametrize("name", SENSES)
def test_a_reading_depends_on_its_seed_and_tick_alone(name):
    """Whatever the batch around it, and wherever in it: the same numbers; another seed, others."""
    start = starting(name) | ({"chance": 0.3} if name == "dropped_readings" else {})
    worlds = [placed(name, "all", **{**start, "seed": s}) for s in (5, 6, 5)]
    together, alone = sensed(worlds, 50), sensed(worlds[:1], 50)
    np.testing.assert_array_equal(together[:, 0], alone[:, 0])
    np.testing.assert_array_equal(together[:, 2], alone[:, 0])
    assert not np.array_equal(together[:, 1], alone[:, 0])


def test_encoder_noise_is_white_gaussian_of_its_own_for_each_joint_and_channel():
    world = placed("encoder_noise", "all", sd=0.004, velocity=0.02, seed=11)
    n = 4000
    off = sensed([world], n)[:, 0] - np.stack([np.arange(n), -np.arange(n)], axis=1)[:, :, None]  # (n, 2, 7)
    np.testing.assert_allclose(off[:, 0].std(axis=0), 0.004, rtol=0.05)
    np.testing.assert_allclose(off[:, 1].std(axis=0), 0.02, rtol=0.05)
    flat = off.reshape(n, 14) / off.reshape(n, 14).std(axis=0)
    assert np.abs(np.corrcoef(flat.T) - np.eye(14)).max() < 0.07
    assert np.abs(np.mean(flat[1:] * flat[:-1], axis=0)).max() < 0.07, "white from tick to tick"
    assert np.abs(np.mean(flat**4, axis=0) - 3).max() < 0.5, "Gaussian"


def test_dropped_readings_repeat_the_last_at_the_stated_rate_and_never_the_first():
    n, chance = 8000, 0.05
    q = sensed([placed("dropped_readings", "all", chance=chance, seed=3)], n)[:, 0, 0]
    assert (q == q[:, :1]).all(), "a lost packet is lost for all joints"
    steps = np.arange(n)
    lost = q[:, 0] != steps
    assert not lost[0]
    np.testing.assert_array_equal(q[1:, 0][lost[1:]], q[:-1, 0][lost[1:]])
    assert abs(lost.mean() - chance) < 4 * np.sqrt(chance * (1 - chance) / n)


def test_a_late_wrench_is_exactly_late_and_begins_with_its_first_reading():
    """Of whole ticks exactly, between them halfway: against the oracle that looks the past up."""
    true, late, between = np.moveaxis(
        weighed([World(), *(placed("wrench_delay", "flange", delay=d) for d in (0.02, 0.0125))], 60), 1, 0
    )
    past = true[np.maximum(np.arange(60)[:, None] - np.arange(5), 0)]  # (60, 5, 6), the last five readings
    np.testing.assert_array_equal(late, past[:, 4])
    np.testing.assert_allclose(between, 0.5 * (past[:, 2] + past[:, 3]), rtol=1e-12)


def test_wrench_noise_is_white_gaussian_of_its_own_for_each_force_and_torque():
    n = 4000
    worlds = [World(), *(placed("wrench_noise", "flange", force=0.3, torque=0.02, seed=s) for s in (5, 6, 5))]
    readings = weighed(worlds, n)
    off = readings[:, 1] - readings[:, 0]
    np.testing.assert_allclose(off.std(axis=0), [0.3] * 3 + [0.02] * 3, rtol=0.05)
    flat = off / off.std(axis=0)
    assert np.abs(np.corrcoef(flat.T) - np.eye(6)).max() < 0.07
    assert np.abs(np.mean(flat[1:] * flat[:-1], axis=0)).max() < 0.07, "white from tick to tick"
    assert np.abs(np.mean(flat**4, axis=0) - 3).max() < 0.5, "Gaussian"
    np.testing.assert_array_equal(readings[:, 3], readings[:, 1], err_msg="one seed, one stream, in any row")
    assert np.abs(np.mean(flat * (readings[:, 2] - readings[:, 0]) / off.std(axis=0), axis=0)).max() < 0.07
    np.testing.assert_array_equal(weighed(worlds[1:2], 50)[:, 0], readings[:50, 1])


def test_gain_and_bias_of_the_wrench_are_an_affine_reading():
    """Gain first, then bias, whichever is named first; the axes are those that are named."""
    bias = {"fx": 1.0, "fy": -2.0, "fz": 3.0, "tx": 0.1, "ty": -0.2, "tz": 0.3}
    both = placed("wrench_bias", "flange", **bias).add(EffectInstance.of("wrench_gain", "flange", gain=0.9))
    readings = weighed([World(), both], 20)
    np.testing.assert_allclose(readings[:, 1], 0.9 * readings[:, 0] + list(bias.values()), rtol=1e-12, atol=1e-12)


def _body(model: mujoco.MjModel, field: str, i: int) -> str:
    return model.body(int(model.geom_bodyid[i]) if field.startswith("geom_") else i).name


def _bytes(model: mujoco.MjModel) -> bytes:
    buffer = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return buffer.tobytes()
