"""An effect of a user's own: defined here, it is sampled, simulated, fitted and saved like any other."""

from __future__ import annotations

import numpy as np
import pytest
from loops import iiwa_segment, one, recorded

from vispeg.core.effect import REGISTRY, Effect, EffectInstance
from vispeg.core.errors import UserError
from vispeg.core.params import Param
from vispeg.core.seeds import stream
from vispeg.identify.evidence import Evidence
from vispeg.identify.fit import fit_job
from vispeg.identify.pool import run_together
from vispeg.robots.model import load
from vispeg.worlds.model_file import load_model, model_text
from vispeg.worlds.world import World

ROBOT = load("iiwa14")


@pytest.fixture
def drag():
    class AirDrag(Effect):
        """Torque against the square of the velocity."""

        name = "air_drag"
        kind = "joint"
        params = {"coefficient": Param(0.0, 0.0, 20.0, "N m s2/rad2", start=1.0, doc="torque per squared velocity")}

        def torque(self, state, x, p):
            return -p["coefficient"] * x.dq * np.abs(x.dq)

    yield REGISTRY["air_drag"]
    del REGISTRY["air_drag"]


def test_enrols_by_being_defined_and_works(drag, tmp_path):
    truth = World().add(EffectInstance.of("air_drag", "joint2", coefficient=3.0))
    segment = iiwa_segment("position", 1.5)
    evidence = Evidence([recorded(ROBOT, "iiwa14", truth, segment, stream(1, "drag"))])
    start = World().add(EffectInstance.of("air_drag", "joint2", coefficient=1.0))
    (fit,) = run_together([fit_job(evidence, start, [0])], evidence.residuals)
    value = fit.world.effects[0].params["coefficient"]
    assert value.low is not None and value.high is not None
    assert value.low - 0.02 < 3.0 < value.high + 0.02 and value.high - value.low < 0.3
    (tmp_path / "m.yaml").write_text(model_text(fit.world), encoding="utf-8")
    assert load_model(tmp_path / "m.yaml") == fit.world
    null = World().add(EffectInstance.of("air_drag", "joint2", coefficient=0.0))
    np.testing.assert_array_equal(one(ROBOT, null, segment).q, one(ROBOT, World(), segment).q)


def test_a_second_class_of_the_same_name_is_an_error(drag):
    with pytest.raises(UserError, match="registered twice"):

        class Other(Effect):
            """Of the same name."""

            name = "air_drag"
            kind = "joint"
            params = {}


def test_unknown_names_list_the_choices():
    with pytest.raises(UserError, match="coulomb_friction"):
        EffectInstance.of("colomb_friction", "joint1", torque=1.0)
    with pytest.raises(UserError, match="torque"):
        EffectInstance.of("coulomb_friction", "joint1", torqe=1.0)
    with pytest.raises(UserError, match="joint7"):
        one(
            ROBOT,
            World().add(EffectInstance.of("coulomb_friction", "joint9", torque=1.0)),
            iiwa_segment("position", 0.2),
        )
