"""Contact effects mean the same whatever a user's object states: either form of `solref`, against MuJoCo's physics."""

from __future__ import annotations

import numpy as np
import pytest
from mujoco import batch as mjb

from vispeg.core.effect import EffectInstance
from vispeg.core.errors import UserError
from vispeg.diagnosis.objects import contact_numbers
from vispeg.effects.contact.restitution import rebound
from vispeg.robots.objects import ObjectModel, load_object
from vispeg.sim.placement import activate
from vispeg.sim.state import Fields
from vispeg.worlds.world import World

NOMINAL = World()
RADIUS, STEP = 0.1, 2e-4  # m, s
STANDARD, DIRECT = 'solref="0.02 0.5"', 'solref="-10000 -100"'  # the same contact
SOFT, ELASTIC = 'solref="-1000 -10"', 'solref="-1000 0"'
BALL = """<mujoco><option gravity="0 0 0"/><worldbody><geom type="plane" size="1 1 .1" solref="-500 -1"/>
<body name="ball" pos="0 0 0.1"><freejoint/><geom size="0.1" mass="0.4" {}/></body></worldbody></mujoco>"""


@pytest.fixture
def ball(tmp_path):
    """Return what loads a weightless ball on a plane, its contact as the attributes of its geom state."""

    def loaded(contact: str) -> ObjectModel:
        (tmp_path / "ball.xml").write_text(BALL.format(contact))
        return load_object(tmp_path / "ball.xml")

    return loaded


def one(name: str, **values: float) -> World:
    return World().add(EffectInstance.of(name, "ball", **values))


def written(model: ObjectModel, worlds: list[World]) -> mjb.Batch:
    batch = mjb.Batch(model.compile(STEP), len(worlds), nthread=1)
    batch.expand("opt.tolerance")[:] = 0.0  # forces of some nanometres of depth count, too
    fields = Fields(batch, model)
    for a in activate(model, worlds):
        a.effect.write(fields, a.p)
    return batch


def acceleration(batch: mjb.Batch, depth, speed: float = 0.0, load: float = 0.0) -> np.ndarray:
    """Upward acceleration (n,) of balls pressed `depth` (n,) m deep, going down at `speed`, under `load` N/kg."""
    batch.bind("qpos")[:, 2] = RADIUS - np.asarray(depth)
    batch.bind("qvel")[:, 2] = -speed
    batch.bind("xfrc_applied")[:, 1, 2] = -load * batch.model.body("ball").mass
    out = batch.bind("qacc")
    batch.forward()
    return out[:, 2].copy()


def holds(batch: mjb.Batch, depth) -> np.ndarray:
    """Load (n,) in N/kg under which balls rest `depth` (n,) m deep; the acceleration is linear in the load."""
    none = acceleration(batch, depth)
    return none / (none - acceleration(batch, depth, load=1.0))


def bounces(batch: mjb.Batch, speed: float = 1.0) -> np.ndarray:
    """Fraction (n,) of their speed with which balls come back."""
    batch.bind("qpos")[:, 2] = RADIUS + 1e-4
    batch.bind("qvel")[:, 2] = -speed
    touches = batch.bind("ncon")
    batch.step(nstep=round(0.4 / STEP))
    assert (touches == 0).all()
    return batch.bind("qvel")[:, 2] / speed


@pytest.mark.parametrize("contact", [STANDARD, DIRECT, SOFT])
def test_damping_scales_alone(ball, contact):
    scales = np.array([1.0, 0.2, 0.5, 2.0])
    batch = written(ball(contact), [NOMINAL, *(one("contact_damping", scale=s) for s in scales[1:])])
    still = acceleration(batch, 1e-4)
    damped = acceleration(batch, 1e-4, speed=0.01) - still
    np.testing.assert_allclose(damped / damped[0], scales, rtol=1e-6)
    np.testing.assert_allclose(holds(batch, 1e-4), holds(batch, 1e-4)[0], rtol=1e-6)


@pytest.mark.parametrize("contact", [STANDARD, DIRECT, SOFT, ELASTIC])
def test_a_load_presses_one_over_the_stiffness_as_deep(ball, contact):
    scales = np.array([1.0, 0.02, 0.25, 4.0])
    batch = written(ball(contact), [NOMINAL, *(one("contact_stiffness", scale=s) for s in scales[1:])])
    for depth in (1e-6, 1e-4):
        load = holds(batch, depth / scales)
        np.testing.assert_allclose(load / load[0], 1.0, rtol=0.03)


@pytest.mark.parametrize(
    "impedance",
    ["0.9 0.95 0.001", "0.9 0.95 1e-6", "0.9 0.95 0.001 0.5 1", "0.95 0.9 0.002 0.2 6", "0.5 0.95 0.001"]
    + ["0 0.95 0.001", "0.9 1 0.001", "1 1 0.001", "0 0 0.001"],  # beyond the limits in which MuJoCo keeps it
)
def test_stiffness_scales_at_the_surface_and_at_full_depth_of_any_impedance(ball, impedance):
    scales = np.array([1.0, 0.02, 0.25, 4.0])
    model = ball(f'solimp="{impedance}"')
    batch = written(model, [NOMINAL, *(one("contact_stiffness", scale=s) for s in scales[1:])])
    for depth in (1e-9, 0.003):
        load = holds(batch, depth / scales)
        np.testing.assert_allclose(load / load[0], 1.0, rtol=2e-3)


@pytest.mark.parametrize(("contact", "own"), [(STANDARD, 0.5), (DIRECT, 0.5), (SOFT, 10 / 2 / 1000**0.5), (ELASTIC, 0)])
def test_a_ball_comes_back_with_the_stated_fraction_or_its_own(ball, contact, own):
    model, e = ball(contact), np.array([0.0, 0.2, 0.6, 0.8])
    worlds = [NOMINAL, *(one("restitution", e=v) for v in e[1:])]
    np.testing.assert_allclose(bounces(written(model, worlds)), np.maximum(e, rebound(own)), atol=5e-3)
    stated = [contact_numbers(model, world)["restitution"] for world in worlds]
    np.testing.assert_allclose(stated, np.maximum(e, rebound(own)), atol=1e-4)


def test_one_contact_in_either_form_is_the_same_with_every_effect(ball):
    worlds = [NOMINAL, one("contact_damping", scale=0.3), one("contact_stiffness", scale=0.1)]
    worlds += [one("restitution", e=0.7), worlds[1].add(*one("contact_stiffness", scale=3.0).effects)]
    np.testing.assert_allclose(*(bounces(written(ball(form), worlds)) for form in (STANDARD, DIRECT)), rtol=1e-9)
    for world in worlds:
        standard, direct = (contact_numbers(ball(form), world) for form in (STANDARD, DIRECT))
        assert standard == pytest.approx(direct, rel=1e-9)


def test_a_contact_without_damping_has_no_time_constant(ball):
    stated = contact_numbers(ball(ELASTIC), NOMINAL)
    assert str(stated) == "{'friction': 1.0, 'damping_ratio': 0.0, 'restitution': 1.0}", "no -0.0 in a report"


def test_numbers_of_an_object_are_those_of_a_shape_that_touches(ball, tmp_path):
    """A mesh that is only drawn often comes first in a file, and no effect changes it."""
    drawn = BALL.replace("<geom size", '<geom size="0.1" contype="0" conaffinity="0" mass="0"/><geom size')
    (tmp_path / "drawn.xml").write_text(drawn.format(DIRECT))
    world = one("contact_friction", scale=0.5).add(*one("restitution", e=0.6).effects)
    assert contact_numbers(load_object(tmp_path / "drawn.xml"), world) == contact_numbers(ball(DIRECT), world)


def test_bodies_fixed_to_an_object_are_a_part_of_it(ball, tmp_path):
    """A shell as a body of its own in the free body: friction, bounce and mass as of one body."""
    inner = '<geom size="0.05" mass="0.1" {0}/><body name="shell"><geom size="0.1" mass="0.3" {0}/></body></body>'
    (tmp_path / "shell.xml").write_text(BALL.replace('<geom size="0.1" mass="0.4" {}/></body>', inner).format(DIRECT))
    worlds = [NOMINAL, one("restitution", e=0.7), one("contact_damping", scale=0.3), one("object_mass", scale=2.0)]
    model = load_object(tmp_path / "shell.xml")
    np.testing.assert_allclose(*(bounces(written(m, worlds)) for m in (model, ball(DIRECT))), rtol=1e-9)
    assert contact_numbers(model, worlds[1]) == contact_numbers(ball(DIRECT), worlds[1])
    assert written(model, worlds).expand("body_mass")[:, 1:].sum(axis=1) == pytest.approx([0.4, 0.4, 0.4, 0.8])


def test_a_part_that_cannot_be_fused_is_refused(tmp_path):
    part = '<body name="shell" fuse="false"><geom size="0.1"/></body></body>'
    (tmp_path / "apart.xml").write_text(BALL.replace("</body>", part).format(DIRECT))
    with pytest.raises(UserError, match=r"bodies that MuJoCo can fuse with 'ball'.*shell"):
        load_object(tmp_path / "apart.xml")
