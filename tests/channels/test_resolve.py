"""Command, comparison, fit, page and API look in the same channels of the same recordings, whatever these hold."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from vispeg.api import compare as of_compare
from vispeg.api import diagnose as of_diagnose
from vispeg.api import fit as of_fit
from vispeg.channels.resolve import available, fitted_in, resolve
from vispeg.cli.main import main
from vispeg.core.errors import UserError
from vispeg.identify.excitation import motion
from vispeg.identify.record import centre_of, controller, record
from vispeg.recordings.cell import CellBelief, WrenchSensor
from vispeg.recordings.frames.camera import RecordedCamera
from vispeg.recordings.frames.frames import Frames, RecordedFrame
from vispeg.recordings.noise import NOISE
from vispeg.recordings.recording import Control
from vispeg.recordings.write import write
from vispeg.robots.model import load
from vispeg.robots.objects import CUBE
from vispeg.view.diagnose import study as of_study
from vispeg.worlds.world import World

# what is kept of a recording of the cell with everything; the model; channels that there are, and those looked in
ALL = {"torque", "control", "wrench", "frames"}
CASES = {
    "arm, controller": ("iiwa14", {"control"}, ("joints",), ("joints",)),
    "arm, torque": ("iiwa14", {"torque"}, ("joints",), ("joints",)),
    "arm with pictures of a cell": ("iiwa14", ALL, ("joints",), ("joints",)),
    "cell, wrench": ("peg-cell", {"wrench"}, ("contact",), ("contact",)),
    "cell, wrench and torque": ("peg-cell", {"wrench", "torque"}, ("joints", "contact"), ("contact",)),
    "cell, pictures": ("peg-cell", {"frames"}, ("pictures",), ("pictures",)),
    "cell, pictures and torque": ("peg-cell", {"frames", "torque"}, ("joints", "pictures"), ("pictures",)),
    "cell, pictures and wrench": ("peg-cell", {"frames", "wrench"}, ("pictures", "contact"), ("pictures", "contact")),
    "cell, all": ("peg-cell", ALL, ("joints", "pictures", "contact"), ("joints", "pictures", "contact")),
    "nothing": ("iiwa14", set(), (), ("joints",)),
}


class Asked(Exception):
    """What a resolver answered, before anything is computed."""


@pytest.fixture(scope="module")
def whole():
    """Two recordings with joint torques, a known controller, a wrench that feels nothing, and frames."""
    robot, rng = load("iiwa14", tool="meg50+peg16"), np.random.default_rng(0)
    eye = RecordedCamera("wrist_wide", 64, 48, 40.0, 40.0, 32.0, 24.0, mount="flange", pose=np.eye(4))
    frames = Frames({eye.name: eye}, (RecordedFrame(0.2, eye, np.zeros((48, 64, 3), np.uint8)),))
    out = []
    for name in "ab":
        move = motion("fourier", robot, 100.0, 1.0, rng)
        servo = controller(robot, "position", 100.0, centre_of(robot))
        rec = record(World("iiwa14", "meg50+peg16"), move, servo, NOISE, rng, name=name)
        ft = rng.normal(0.0, np.repeat([0.1, 0.005], 3), (len(rec.time), 6))
        more = {"noise": {**rec.noise, "ft": 0.1, "ft_torque": 0.005}, "cell": CellBelief("nominal")}
        out.append(replace(rec, path=Path(name), ft=ft, wrench=WrenchSensor(), frames=frames, **more))
    return out


def kept(rec, what):
    """The recording with no more than this; a torque sensor alone does not make a controller known."""
    if "torque" not in what:
        rec = replace(rec, tau=None, torque_sensor="none")
    if "control" not in what:
        rec = replace(rec, control=Control("unknown", rec.rate_hz), q_cmd=None, dq_cmd=None)
    if "wrench" not in what:
        rec = replace(rec, ft=None, wrench=None)
    return rec if "frames" in what else replace(rec, frames=None)


@pytest.mark.parametrize("case", CASES)
def test_the_channels_that_a_model_and_recordings_have(whole, case):
    model, what, there, used = CASES[case]
    both = tuple(kept(rec, what) for rec in whole)
    world = of_diagnose.read_inputs(model, *both).world
    assert available(world, both) == there
    assert resolve(world, both) == used


def test_all_look_in_the_same_channels(whole, tmp_path, monkeypatch):
    """Commands, page and Python ask the one resolver, and hand on what was asked of them."""
    both = tuple(kept(rec, {"wrench", "torque"}) for rec in whole)
    sides = [str(write(rec, tmp_path / name)) for rec, name in zip(both, "ab", strict=True)]
    answered = []

    def ask(*args, **options):
        answered.append(resolve(*args, **options))
        raise Asked

    for module in (of_diagnose, of_compare, of_fit, of_study):
        monkeypatch.setattr(module, "resolve", ask)
    cell, effects, asked = "peg-cell", ["viscous_friction:joint1"], ("joints", "contact")
    first, last = ["--recording", sides[0]], ["--validate", sides[1]]
    wanted = ["--channels", *asked, "--quiet", "--out", str(tmp_path / "out")]
    page = partial(of_study.Study, lambda *_: None, cell, (Path(sides[0]),), (Path(sides[1]),), tmp_path / "page", 1)
    by_default = (
        lambda: of_diagnose.diagnose(cell, *both),
        lambda: of_compare.compare(cell, list(both)),
        lambda: of_fit.fit(cell, both[0], effects, both[1]),
        page,
    )
    as_asked = (
        lambda: main(["diagnose", cell, *first, *last, *wanted]),
        lambda: main(["compare", cell, *first, *wanted]),
        lambda: main(["fit", cell, *first, *last, "--effects", *effects, *wanted]),
        lambda: main(["diagnose", cell, *first, *last, "--rooms", *wanted[1:]]),
    )
    for calls, channels in ((by_default, ("contact",)), (as_asked, asked)):
        for call in calls:
            with pytest.raises(Asked):
                call()
        assert answered == [channels] * len(calls)
        answered.clear()


def test_tosses_are_diagnosed_and_nothing_else(tmp_path):
    """A free object has one channel; what cannot read tosses refuses them in one line."""
    cube = tmp_path / "cube.xml"
    cube.write_text(CUBE)
    assert resolve(World(str(cube))) == resolve(World(str(cube)), asked=("tosses",)) == ("tosses",)
    with pytest.raises(UserError, match="have this channel"):
        of_diagnose.diagnose(str(cube), tmp_path, tmp_path, channels=("joints",))
    for call in (
        lambda: of_compare.compare(str(cube), tmp_path),
        lambda: of_fit.fit(str(cube), tmp_path, ["contact_friction:cube"]),
        lambda: of_study.Study(lambda *_: None, str(cube), (tmp_path,), (), tmp_path / "page", 1),
    ):
        with pytest.raises(UserError, match="vispeg diagnose reads"):
            call()


def test_a_fit_is_made_where_its_effects_show():
    every = ("joints", "pictures", "contact")
    assert fitted_in(every, ["viscous_friction", "payload"]) == "joints"
    assert fitted_in(every, ["camera_offset", "lens_distortion"]) == "pictures"
    assert fitted_in(every, ["contact_friction", "wrench_gain"]) == "contact"
    assert fitted_in(("pictures",), ["viscous_friction"]) == "pictures", "no other is there"
