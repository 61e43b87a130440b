"""Every look and every camera fault that a built-in world draws changes the picture's model or the picture."""

from __future__ import annotations

import numpy as np
import pytest
from clamped import SCENE

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.frame import Frame
from vispeg.core.seeds import stream
from vispeg.render.cameras.pipeline import Pipeline
from vispeg.render.look import Fields
from vispeg.sim.placement import activate
from vispeg.task.world_file import built_in, load_world
from vispeg.worlds.randomized import RandomizedEffect
from vispeg.worlds.world import World

ALL = [r for name in built_in() for r in load_world(name).world.ranges]
LOOKS = {f"{r.label} {r.params}": r for r in ALL if effect(r.effect).family == "appearance"}
FAULTS = {f"{r.label} {r.params}": r for r in ALL if effect(r.effect).overrides("image")}


def at(r: RandomizedEffect, quantile: float) -> World:
    """The effect at every place of the range, each parameter at this quantile."""
    values = {k: v if isinstance(v, float) else v.at(quantile) for k, v in r.params.items()}
    places = effect(r.effect).targets(SCENE) if r.where in ("each", "all") else [r.where]
    return World().add(*(EffectInstance.of(r.effect, where, **values) for where in places))


def images() -> Frame:
    """A slanted surface with a near post before it and a fine pattern on all, 32 x 32 px."""
    rng, size = stream(1, "looks"), 32
    v, u = np.mgrid[:size, :size]
    depth = np.where((u > 11) & (u < 20), 0.06, 0.12 + 0.002 * u + 0.001 * v).astype(np.float32)
    rgb = np.clip(0.5 + 0.3 * rng.standard_normal((size, size, 3)), 0, 1).astype(np.float32)
    K = np.array([[30.0, 0, 15.5], [0, 30.0, 15.5], [0, 0, 1]])
    return Frame(rgb[None].copy(), depth[None].copy(), K[None], truth=depth[None].copy(), time=np.zeros(1))


@pytest.mark.parametrize("text", sorted(LOOKS))
def test_a_look_writes_what_it_says(text):
    from vispeg.render.backends.pristine import place

    r, changed = LOOKS[text], False
    model = SCENE.compile()
    for quantile in (0.02, 0.98):
        for a in activate(SCENE, [at(r, quantile)]):
            before = {name: place(model, name).copy() for name in a.effect.writes}
            a.effect.write(Fields(model, SCENE), a.p)
            changed |= any(not np.array_equal(before[n], place(model, n)) for n in before)
    assert changed, r


@pytest.mark.parametrize("text", sorted(FAULTS))
def test_a_fault_changes_the_picture(text):
    """Within 60 frames of a still scene whose clock runs; latency and loss show on a scene that changes."""
    r = FAULTS[text]
    camera = r.where if r.where in SCENE.cameras else SCENE.cameras[0]
    pipeline, changed = Pipeline([at(r, 0.98)], camera), False
    for k in range(60):
        frame, plain = images(), images()
        for f in (frame, plain):
            f.time = np.array([0.16 * k])
            f.depth += np.float32(0.001 * k)
            f.truth = f.depth.copy()
            f.velocity = np.array([[0.1, 0.05, 0.0, 0.0, 0.0, 0.2]])
        out = pipeline.run(frame, [stream(2, k)])
        changed |= not (np.array_equal(out.rgb, plain.rgb) and np.array_equal(out.depth, plain.depth))
    assert changed, r
