"""What every effect promises, measured for each one by walking the registry: a new file is tested by being there."""

from __future__ import annotations

from functools import lru_cache

import mujoco
import numpy as np
import pytest
from loops import iiwa_segment, mode_of, one
from mujoco import batch as mjb

from vispeg.core.effect import REGISTRY as EVERY
from vispeg.core.effect import EffectInstance, searchable
from vispeg.core.params import Value
from vispeg.core.seeds import stream
from vispeg.robots.model import load
from vispeg.sim.compiled import compiled
from vispeg.sim.placement import activate
from vispeg.sim.rollout import simulate
from vispeg.sim.state import DriveState, Fields
from vispeg.worlds.model_file import load_model, model_text
from vispeg.worlds.words import completed
from vispeg.worlds.world import World

REGISTRY = searchable()  # what an arm alone can show

NAMES = sorted(REGISTRY)
MODES = ("position", "torque", "osc", "servo")
ROBOT = load("iiwa14")
# a sampled loop with these beyond some value is unstable on a real robot as well (a hardly massive wrist link, too)
MAY_DIVERGE = {
    "actuator_lag",
    "backlash",
    "command_delay",
    "joint_elasticity",
    "link_mass",
    "sensor_delay",
    "torque_limit",
}


@lru_cache
def segment(mode: str, seconds: float = 0.5):
    return iiwa_segment(mode, seconds)


@lru_cache
def nominal(mode: str):
    return one(ROBOT, World(), segment(mode))


def null_world(names) -> World:
    """Effects at null at every place; shape parameters away from their start, for they must not matter."""
    out = World()
    for name in names:
        params = REGISTRY[name].params
        values = {k: 0.5 * (p.start + p.high) if p.shape else p.null for k, p in params.items()}
        out = out.add(*(EffectInstance.of(name, where, **values) for where in REGISTRY[name].targets(ROBOT)))
    return out


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", NAMES)
def test_null_is_bit_identical_to_no_effect(name, mode):
    response, plain = one(ROBOT, null_world([name]), segment(mode)), nominal(mode)
    for channel in ("q", "dq", "tau_joint", "tau_motor"):
        np.testing.assert_array_equal(getattr(response, channel), getattr(plain, channel), err_msg=channel)


@pytest.mark.parametrize("mode", MODES)
def test_all_effects_at_null_together_are_bit_identical_to_none(mode):
    response, plain = one(ROBOT, null_world(NAMES), segment(mode)), nominal(mode)
    for channel in ("q", "dq", "tau_joint", "tau_motor"):
        np.testing.assert_array_equal(getattr(response, channel), getattr(plain, channel), err_msg=channel)


@pytest.mark.parametrize("name", NAMES)
def test_another_row_is_not_touched(name):
    """A world without the effect is what it is alone, whatever its neighbours in the batch carry."""
    kind = REGISTRY[name]
    strong = World().add(
        *(EffectInstance.of(name, w, **{k: p.start for k, p in kind.params.items()}) for w in kind.targets(ROBOT))
    )
    mode = mode_of(kind)
    pair = simulate(ROBOT, [strong, World()], [segment(mode)])[0]
    np.testing.assert_array_equal(pair.q[1], nominal(mode).q[0])
    assert not np.array_equal(pair.q[0], pair.q[1]), "the effect at its start value does nothing"


COMMANDED = [name for name in NAMES if REGISTRY[name].commanded]


@pytest.mark.parametrize("name", COMMANDED)
def test_a_drive_of_the_command_alone_sees_no_motion(name):
    """Two arms that move each in their own way under the same commands get the same torque, step by step."""
    kind, rng = REGISTRY[name], stream(2, name)
    p = {k: np.full((3, 7), param.start) for k, param in kind.params.items()}

    def arm():
        return DriveState(1e-3, 2e-3, *rng.normal(size=(5, 3, 7)))

    states = [kind.start(arm(), p) for _ in range(2)]
    for tau in rng.normal(0.0, 50.0, (20, 3, 7)):
        np.testing.assert_array_equal(*(kind.drive(state, tau, arm(), p) for state in states))


@pytest.mark.parametrize("name", NAMES)
def test_finite_at_every_bound(name):
    """At each bound of each parameter, at each place: an answer, or a divergence that is said to be one."""
    kind = REGISTRY[name]
    start = {k: p.start for k, p in kind.params.items()}
    worlds = [
        World().add(EffectInstance.of(name, where, **{**start, k: bound}))
        for where in kind.targets(ROBOT)
        for k, p in kind.params.items()
        for bound in (p.low, p.high)
    ]
    y = simulate(ROBOT, worlds, [segment(mode_of(kind))], h_max=2e-3)[0]
    assert np.isfinite(y.q[~y.diverged]).all() and np.isfinite(y.tau_joint[~y.diverged]).all()
    assert np.isnan(y.q[y.diverged]).all()
    if name not in MAY_DIVERGE:
        assert not y.diverged.any(), [worlds[i].label for i in np.flatnonzero(y.diverged)]
        assert np.abs(y.q).max() < 2 * np.pi


@pytest.mark.parametrize("name", NAMES)
def test_only_the_declared_fields_change(name):
    """`write` changes what it declares, in the rows and at the places that it is asked for; the model itself never."""
    kind, model = REGISTRY[name], compiled(ROBOT)
    before = _bytes(model)
    where = kind.targets(ROBOT)[-1]
    placed = EffectInstance.of(name, where, **{k: p.start for k, p in kind.params.items()})
    active = activate(ROBOT, [World(), World().add(placed)])
    batch = mjb.Batch(model, 2, nthread=1)
    fields = Fields(batch, ROBOT)
    for a in active:
        a.effect.write(fields, a.p)
    changed = set()
    for field in fields.touched:
        value = batch.expand(field)
        owner = model.opt if field.startswith("opt.") else model
        base = np.asarray(getattr(owner, field.removeprefix("opt."))).reshape(value.shape[1:])
        np.testing.assert_array_equal(value[0], base, err_msg=f"{field} of a world without the effect")
        if not np.array_equal(value[1], base):
            changed.add(field)
            rows = [i for i in range(len(base)) if not np.array_equal(value[1, i], base[i])]
            assert field.startswith("opt.") or len(rows) == 1, f"{field} changed at {rows} for one place"
    assert fields.touched <= kind.writes
    assert bool(changed) == bool(kind.writes)
    assert _bytes(model) == before


def _bytes(model: mujoco.MjModel) -> bytes:
    buffer = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return buffer.tobytes()


@pytest.mark.parametrize("name", NAMES)
def test_model_file_keeps_everything(name, tmp_path):
    rng = stream(3, name)
    placed = []
    for where in REGISTRY[name].targets(ROBOT):
        params = {}
        for k, p in REGISTRY[name].params.items():
            low, value, high = np.sort(rng.uniform(p.low, p.high, 3))
            params[k] = Value(float(value), float(low), float(high))
        placed.append(EffectInstance(name, where, params, {"fitted_on": ["rig-a"], "heldout_error_after": 1e-5}))
    world = World("iiwa14", {"mass_kg": 0.3, "com_m": [0, 0, 0.1], "inertia_kgm2": [1e-3, 1e-3, 1e-3]}, tuple(placed))
    path = tmp_path / "model.yaml"
    path.write_text(model_text(world), encoding="utf-8")
    assert load_model(path) == world


@pytest.mark.parametrize("name", NAMES)
def test_parameters_are_stated_well(name):
    """Null inside the bounds, a start that differs from it, names that exist, targets of the arm."""
    kind = REGISTRY[name]
    assert kind.magnitudes, "an effect needs a parameter that switches it off"
    for key, p in kind.params.items():
        assert p.low <= p.null <= p.high or p.shape, key
        assert p.shape or p.start != p.null, key
        assert p.unit and p.doc and (p.scale == "linear" or p.low > 0), key
    assert set(kind.telling) <= set(kind.params) and set(kind.contains) <= set(REGISTRY)
    known = {*ROBOT.joints, *ROBOT.links, "flange", "base"}
    assert set(kind.targets(ROBOT)) <= known
    assert type(kind).__doc__


def test_a_size_that_is_named_stands_alone():
    """Naming one size of an effect leaves the others at null; naming none takes the typical ones, shapes always."""
    for name, kind in sorted(EVERY.items()):
        typical = {k: p.start for k, p in kind.params.items()}
        assert completed(kind, {}) == typical
        for magnitude in kind.magnitudes:
            full = completed(kind, {magnitude: kind.params[magnitude].start})
            for other, param in kind.params.items():
                alone = param.start if param.shape or other == magnitude else param.null
                assert full[other] == alone, f"{name}: {magnitude} given, {other}"


@pytest.mark.parametrize("name", [n for n, kind in REGISTRY.items() if kind.conservative])
def test_a_conservative_torque_is_one_of_the_angle_alone(name):
    """Whatever the speed and the load, and with nothing to remember: so it takes no work out of a closed path."""
    kind, rng = REGISTRY[name], stream(4, "conservative", name)
    if not kind.overrides("torque"):
        assert kind.writes <= {"jnt_stiffness", "qpos_spring"}, "a spring of MuJoCo's"
        return
    assert not kind.overrides("start")
    q, p = rng.uniform(-1.0, 1.0, (5, 7)), {k: np.full((5, 7), param.start) for k, param in kind.params.items()}
    ways = [DriveState(1e-3, 1e-3, q, *rng.standard_normal((3, 5, 7)), np.ones((5, 7))) for _ in range(3)]
    first, *others = [kind.torque(None, x, p) for x in ways]
    assert np.any(first)
    for other in others:
        np.testing.assert_array_equal(other, first)
