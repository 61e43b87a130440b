"""Every effect that a wrench shows goes round: hidden in the simulator, put into the model, it leaves noise.

A sign, an axis or a unit that simulator and evidence take differently leaves more than was there before.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pressed import SCENE, recorded, recorded_together

from vispeg.contact.run import evidence_of
from vispeg.contact.selection.profile import BLOWS, looked_for, place_of, tries
from vispeg.core.effect import EffectInstance, effect
from vispeg.core.errors import UserError
from vispeg.identify.fit import fit_job
from vispeg.identify.pool import run_together
from vispeg.recordings.cell import WrenchSensor
from vispeg.worlds.world import World

READ = (
    EffectInstance.of("wrench_bias", "flange", fx=1.5, fz=-2.0, ty=0.15),
    EffectInstance.of("wrench_gain", "flange", gain=1.2),
    EffectInstance.of("wrench_delay", "flange", delay=0.02),
)
WEIGHED = (
    EffectInstance.of("tool_mass", "gripper", mass=0.4),
    EffectInstance.of("tool_com", "gripper", x=0.008, y=-0.006),
    EffectInstance.of("object_mass", "peg", scale=3.0),
)


def left(rec, *worlds: World) -> list[float]:
    """Squared residual of each world, per reading."""
    evidence = evidence_of([rec])
    return [float(r @ r / evidence.count) for r in evidence.residuals(list(worlds))]


def as_reaction(rec):
    """The same recording by a sensor that states what the tool exerts on the flange."""
    return replace(rec, ft=-rec.ft, wrench=WrenchSensor(acts_on="flange"))


@pytest.mark.parametrize("hidden", [*READ, *WEIGHED], ids=lambda e: e.effect)
def test_what_is_hidden_in_the_simulator_is_what_the_model_lacks(hidden):
    """However the sensor states its side."""
    every = (*READ, *WEIGHED)
    plain, *others = recorded_together([(), *((e,) for e in every)])
    rec = others[every.index(hidden)]
    (noise,) = left(plain, World())
    for read in (rec, as_reaction(rec)):
        without, right = left(read, World(), World().add(hidden))
        assert right < 1.5 * noise < 0.8 * without


@pytest.mark.parametrize("hidden", READ, ids=lambda e: e.effect)
def test_a_sensor_s_error_that_is_found_and_simulated_again_reads_the_same(hidden):
    """Fitted from its usual size, then hidden in place of the true one: readings differ by less than their noise."""
    rec = recorded((hidden,))
    evidence = evidence_of([rec])
    params = effect(hidden.effect).params
    there = {k for k, v in hidden.params.items() if v.value != params[k].null}
    evidence.absent = {(hidden.effect, k) for k in params if k not in there}
    usual = EffectInstance.of(hidden.effect, hidden.where, **{k: params[k].start for k in there})
    (fit,) = run_together([fit_job(evidence, World().add(usual), [0])], evidence.residuals)
    found = usual.with_values(**{k: fit.world.effects[0].params[k].value for k in there})
    again, plain = recorded((found,)), recorded()
    off, was = (np.percentile(np.abs(r.ft - rec.ft), 90, axis=0) for r in (again, plain))  # a blow lasts some ms
    sigma = np.repeat([rec.noise["ft"], rec.noise["ft_torque"]], 3)
    assert np.all(off < np.maximum(sigma, 0.4 * was)), hidden.label


@pytest.mark.slow
def test_every_effect_at_every_size_leaves_noise_once_it_is_known():
    plants = [(e,) for k in looked_for() if k.stage != BLOWS for _, e in tries(k.name, place_of(k, SCENE))]
    plain, *others = recorded_together([(), *plants])
    (noise,) = left(plain, World())
    for (hidden,), rec in zip(plants, others, strict=True):
        without, right = left(rec, World(), World().add(hidden))
        size = {k: v.value for k, v in hidden.params.items()}
        assert right < max(0.5 * without, 4 * noise), (hidden.label, size)


def test_a_tool_of_any_weight_begins_in_free_air_and_one_that_presses_does_not():
    """What stands free reads the same until it has moved; a reading turned round or of another unit is refused."""
    near = EffectInstance.of("grip_pose", "peg", z=0.003)  # 1 mm above the surface
    plain, heavy, close = recorded_together([(), (WEIGHED[0],), (near,)])
    assert all(evidence_of([rec]).items[0].phase.resting.any() for rec in (heavy, close))
    pressing = int(np.argmax(plain.time > 0.95))  # it stands pressed for 0.5 s, then is lifted
    stands = np.r_[np.full(250, pressing), np.arange(pressing, len(plain.time))]
    rng = np.random.default_rng(0)
    still = replace(
        plain,
        time=np.arange(len(stands)) / plain.rate_hz,
        q=plain.q[stands] + 2e-5 * rng.standard_normal((len(stands), 7)),
        ft=plain.ft[stands] + 0.1 * rng.standard_normal((len(stands), 6)) * ([1] * 3 + [0.05] * 3),
    )
    with pytest.raises(UserError, match="no episode begins in free air"):
        evidence_of([still])
    for wrong in (-1.0, 1000.0, 1e-3):
        with pytest.raises(UserError, match="not what the tool weighs"):
            evidence_of([replace(plain, ft=wrong * plain.ft, noise={**plain.noise, "ft": abs(wrong) * 0.1})])


@pytest.mark.parametrize(("stiffness", "free"), [(1e5, False), (2.5e3, False), (2e2, True)])
def test_a_tool_that_is_lifted_off_what_it_presses_on_does_not_begin_in_free_air(stiffness, free):
    """Pressed with 10 N on a spring, by Hooke's law; what is as soft as a cable is nothing to press on."""
    plain = recorded()
    path = evidence_of([plain]).items[0].path
    gone = np.interp(plain.time, path.time, np.linalg.norm(path.place[:, :3], axis=1))
    pressed = plain.ft.copy()
    pressed[:, 2] -= np.maximum(10.0 - stiffness * np.maximum(gone - 5e-5, 0.0), 0.0)
    rec = replace(plain, ft=pressed)
    if free:
        assert evidence_of([rec]).items[0].phase.resting.any()
    else:
        with pytest.raises(UserError, match=r"no episode begins in free air.* by 2 N a mm or more"):
            evidence_of([rec])
