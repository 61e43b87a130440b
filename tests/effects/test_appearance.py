"""What every look promises, measured for each one by walking the registry, on the compiled cell."""

from __future__ import annotations

import time

import mujoco
import numpy as np
import pytest

from tests.effects.looks import SCENE, field, nominal, written
from vispeg.core.effect import Effect, EffectInstance, of_family
from vispeg.core.seeds import stream
from vispeg.robots.model import load
from vispeg.worlds.model_file import load_model, model_text
from vispeg.worlds.world import World

LOOKS = of_family("appearance")
NAMES = sorted(LOOKS)


def state(model: mujoco.MjModel) -> bytes:
    buffer = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return buffer.tobytes()


def drawn(kind: Effect, seed: int = 0) -> list[EffectInstance]:
    """The effect at every place, each parameter anywhere between its bounds, its first magnitude at its start."""
    rng = stream(seed, kind.name)
    out = []
    for where in kind.targets(SCENE):
        values = {k: rng.uniform(p.low, p.high) for k, p in kind.params.items()}
        first = kind.magnitudes[0]
        out.append(EffectInstance.of(kind.name, where, **{**values, first: kind.params[first].start}))
    return out


def test_there_are_looks_for_parts_lights_and_the_scene():
    where = {t for kind in LOOKS.values() for t in kind.targets(SCENE)}
    assert where == {*SCENE.parts, *SCENE.lights, "scene"}
    assert not any(kind.targets(load("iiwa14")) for kind in LOOKS.values())


@pytest.mark.parametrize("name", NAMES)
def test_null_is_bit_identical(name):
    kind = LOOKS[name]
    null = {k: 0.3 * p.low + 0.7 * p.high if p.shape else p.null for k, p in kind.params.items()}
    placed = [EffectInstance.of(name, w, **null) for w in kind.targets(SCENE)]
    assert state(written(placed).model) == state(nominal())


@pytest.mark.parametrize("name", NAMES)
def test_only_the_declared_fields_change_and_all_of_them_can(name):
    kind = LOOKS[name]
    before = state(nominal())
    changed = set()
    for seed in range(2):
        fields = written(drawn(kind, seed))
        assert fields.touched <= kind.writes
        changed |= {f for f in fields.touched if not np.array_equal(field(fields.model, f), field(nominal(), f))}
        for f in fields.touched:  # nothing else: with these fields as they were, the model is the nominal one
            field(fields.model, f)[...] = field(nominal(), f)
        assert state(fields.model) == before
    assert changed == kind.writes, "a declared field that never changes"
    assert state(nominal()) == before


@pytest.mark.parametrize("name", [n for n in NAMES if len(LOOKS[n].targets(SCENE)) > 1])
def test_one_place_leaves_the_others_alone(name):
    """Drawn at one place and at all: what the others look like is not for this place to say."""
    kind = LOOKS[name]
    everywhere, one = written(drawn(kind)), written(drawn(kind)[:1])
    plain = nominal()
    for f in kind.writes - {"tex_data"}:
        a, b, c = field(one.model, f), field(plain, f), field(everywhere.model, f)
        rows = [i for i in range(len(b)) if not np.array_equal(a[i], b[i])]
        assert len(rows) <= len(SCENE.parts.get(kind.targets(SCENE)[0], (1,))), f
        for i in rows:
            np.testing.assert_array_equal(a[i], c[i], err_msg=f)


@pytest.mark.parametrize("name", NAMES)
def test_finite_and_renderable_at_every_bound(name):
    kind = LOOKS[name]
    start = {k: p.start for k, p in kind.params.items()}
    unit = {"mat_rgba", "mat_specular", "mat_shininess", "mat_reflectance", "geom_rgba"}
    for k, p in kind.params.items():
        for bound in (p.low, p.high):
            fields = written([EffectInstance.of(name, "all", **{**start, k: bound})])
            for f in fields.touched:
                value = field(fields.model, f)
                assert np.isfinite(value).all(), f
                if f in unit:
                    assert value.min() >= 0 and value.max() <= 1, f
            for f in ("light_diffuse", "light_specular", "vis.headlight.ambient", "geom_size"):
                assert field(fields.model, f).min() >= 0
            np.testing.assert_allclose(np.linalg.norm(fields.model.light_dir, axis=1), 1, atol=1e-6)
            np.testing.assert_allclose(np.linalg.norm(fields.model.geom_quat, axis=1), 1, atol=1e-6)


@pytest.mark.parametrize("name", NAMES)
def test_a_drawn_look_replays_from_its_parameters_alone(name, tmp_path):
    placed = drawn(LOOKS[name], 7)
    path = tmp_path / "model.yaml"
    path.write_text(model_text(World(effects=tuple(placed))), encoding="utf-8")
    first, again = state(written(placed).model), state(written(list(load_model(path).effects)).model)
    assert (first == again, first == state(nominal())) == (True, False)


@pytest.mark.parametrize("name", NAMES)
def test_stated_well_and_quick(name):
    kind = LOOKS[name]
    assert kind.magnitudes and type(kind).__doc__
    for key, p in kind.params.items():
        assert p.unit and p.doc and p.low <= p.start <= p.high and (p.scale == "linear" or p.low > 0), key
        assert p.shape or (p.low <= p.null <= p.high and p.start != p.null), key
    placed = drawn(kind)
    written(placed)
    began = time.process_time()
    written(placed)
    assert time.process_time() - began < 0.5
