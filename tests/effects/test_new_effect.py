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
from vispeg.identify.excitation import motion
from vispeg.identify.fit import fit_job
from vispeg.identify.pool import run_together
from vispeg.identify.record import centre_of, controller, record
from vispeg.recordings.noise import NOISE
from vispeg.recordings.windows import taken
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


def test_an_effect_of_time_follows_the_clock_of_the_recording():
    """A torque that grows with `x.t` is zero when the recording begins, and a window cut from it goes on from there."""

    class Creep(Effect):
        """Torque that grows in time."""

        name = "creep"
        family = "joint"
        params = {"slope": Param(0.0, -2.0, 2.0, "N m/s", start=0.1, doc="growth")}

        def torque(self, state, x, p):
            return p["slope"] * x.t

    try:
        truth = World().add(EffectInstance.of("creep", "joint4", slope=0.5))
        run = motion("fourier", ROBOT, 500.0, 3.0, stream(1, "motion"))
        control = controller(ROBOT, "position", 500.0, centre_of(ROBOT))
        rec = record(truth, run, control, NOISE, stream(1, "noise"))
        for part in (rec, taken(rec, [(750, 1500)])):
            evidence = Evidence([part])
            nominal, right = (evidence.rms_error(r) / evidence.floor for r in evidence.residuals([World(), truth]))
            assert right < 1.1 or part is not rec  # the start of a window is known less well
            assert nominal > 10 * right
    finally:
        del REGISTRY["creep"]
