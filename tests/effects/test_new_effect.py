"""An effect of a user's own: defined here, it is sampled, simulated, fitted and saved like any other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from loops import iiwa_segment, one, recorded

from vispeg.core.effect import REGISTRY, Effect, EffectInstance
from vispeg.core.errors import UserError
from vispeg.core.params import Param
from vispeg.core.seeds import stream
from vispeg.formats.yaml_data import read_yaml
from vispeg.identify.evidence import Evidence
from vispeg.identify.excitation import motion
from vispeg.identify.fit import fit_job
from vispeg.identify.inverse import TorqueEvidence
from vispeg.identify.pool import run_together
from vispeg.identify.record import centre_of, controller, record
from vispeg.recordings.importers.mapping import ColumnMap
from vispeg.recordings.importers.table import import_table
from vispeg.recordings.load import load as load_recording
from vispeg.recordings.noise import NOISE
from vispeg.recordings.recording import Control
from vispeg.recordings.windows import taken
from vispeg.recordings.write import write
from vispeg.robots.model import load
from vispeg.sim.rollout import simulate
from vispeg.worlds.model_file import load_model, model_text
from vispeg.worlds.world import World

ROBOT = load("iiwa14")


@pytest.fixture
def drag():
    class AirDrag(Effect):
        """Torque against the square of the velocity."""

        name = "air_drag"
        family = "joint"
        params = {"coefficient": Param(0.0, 0.0, 20.0, "N m s2/rad2", start=1.0, doc="torque per squared velocity")}

        def torque(self, state, x, p):
            slope = p["coefficient"] * np.abs(x.dq)
            return -slope * x.dq / (1 + x.h * slope / x.inertia)

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


def test_a_torque_of_the_speed_at_the_steps_end_is_stable_at_its_bound_on_every_joint(drag):
    """As the guide advises; with the speed at the step's beginning the wrist diverges."""
    worlds = [World().add(EffectInstance.of("air_drag", joint, coefficient=20.0)) for joint in ROBOT.joints]
    assert not simulate(ROBOT, worlds, [iiwa_segment("position", 0.5)], h_max=2e-3)[0].diverged.any()


def test_such_a_torque_is_the_law_itself_along_a_measured_motion(drag):
    """No step is taken there, so the speed at its end is the measured one."""
    rec = recorded(ROBOT, "iiwa14", World(), iiwa_segment("position", 1.5), stream(1, "drag"))
    evidence = TorqueEvidence([replace(rec, control=Control("unknown"))])
    world = World().add(EffectInstance.of("air_drag", "joint7", coefficient=20.0))
    speed = evidence.items[0].segment.dq[:, 6]
    dragged = evidence.torque_of(0, world) - evidence.torque_of(0, World())
    np.testing.assert_allclose(dragged[:, 6], 20.0 * speed * np.abs(speed), atol=1e-9)


def test_a_second_class_of_the_same_name_is_an_error(drag):
    with pytest.raises(UserError, match="registered twice"):

        class Other(Effect):
            """Of the same name."""

            name = "air_drag"
            family = "joint"
            params = {}


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        ({"params": {}}, "Mine.family: not stated; choices: joint, drive"),
        ({"params": {}, "family": "joints"}, r"Mine.family: no such family; got 'joints' \(did you mean 'joint'\?\)"),
        ({"family": "joint"}, "Mine.params: not stated"),
    ],
)
def test_an_effect_without_family_or_parameters_is_refused_in_one_line(stated, said):
    with pytest.raises(UserError, match=said):
        type("Mine", (Effect,), {"name": "mine", **stated})
    assert "mine" not in REGISTRY


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


@pytest.fixture
def creep():
    class Creep(Effect):
        """Torque that grows in time."""

        name = "creep"
        family = "joint"
        params = {"slope": Param(0.0, -2.0, 2.0, "N m/s", start=0.1, doc="growth")}

        def torque(self, state, x, p):
            return p["slope"] * x.t

    yield World().add(EffectInstance.of("creep", "joint4", slope=0.5))
    del REGISTRY["creep"]


def test_an_effect_of_time_follows_the_clock_of_the_recording(creep):
    """A torque that grows with `x.t` is zero when the recording begins, and a window cut from it goes on from there."""
    run = motion("fourier", ROBOT, 500.0, 3.0, stream(1, "motion"))
    control = controller(ROBOT, "position", 500.0, centre_of(ROBOT))
    rec = record(creep, run, control, NOISE, stream(1, "noise"))
    for part in (rec, taken(rec, [(750, 1500)])):
        evidence = Evidence([part])
        nominal, right = (evidence.rms_error(r) / evidence.floor for r in evidence.residuals([World(), creep]))
        assert right < 1.1 or part is not rec  # the start of a window is known less well
        assert nominal > 10 * right


@pytest.mark.parametrize("begins", [5400.0, 1.7e9], ids=["uptime", "epoch"])
def test_the_clock_begins_with_the_recording_whatever_its_times_count_from(creep, begins, tmp_path):
    """A folder, its table converted by a map, and the recording in memory make the same of an effect of time."""
    run = motion("fourier", ROBOT, 500.0, 1.5, stream(1, "motion"))
    rec = record(creep, run, controller(ROBOT, "position", 500.0, centre_of(ROBOT)), NOISE, stream(1, "noise"))
    folder = write(replace(rec, time=rec.time + begins), tmp_path / "rig")
    stated = {k: v for k, v in read_yaml(folder / "recording.yaml").items() if k in ("control", "noise", "tool")}
    stated["torque_sensor"] = rec.torque_sensor
    converted = import_table(folder / "samples.csv", rec.robot, ROBOT.joints, ColumnMap(recording=stated))
    for part in (lambda rec: rec, lambda rec: taken(rec, [(150, 725)])):
        for evidence in (Evidence, TorqueEvidence):
            recordings = [part(r) for r in (rec, load_recording(folder), converted)]
            one, *others = (np.hstack(evidence([r]).residuals([creep])[0]) for r in recordings)
            for other in others:  # times since 1970 are rounded to 0.2 us, so a sample at a border may be left out
                both = (one != 0) & (other != 0)
                assert both.mean() > 0.95 * (one != 0).mean() > 0
                np.testing.assert_allclose(other[both], one[both], atol=0.05)  # of the noise
