"""The model fields that effects write."""

import gc
import weakref

from vispeg.robots.model import load
from vispeg.sim.state import Fields, RowFields


def test_a_model_is_forgotten_with_its_last_user():
    """A process that makes many cells keeps none of them."""
    robot = load("iiwa14")
    model = robot.compile()
    there = weakref.ref(model)
    fields = Fields(RowFields(model, 1), robot)
    assert fields.joints.tolist() == [model.joint(name).id for name in robot.joints]
    del fields, model
    gc.collect()
    assert there() is None
