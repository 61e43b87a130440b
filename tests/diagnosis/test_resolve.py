"""Command, comparison, fit, page and API look in the same channels of the same recordings, whatever these hold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vispeg.api import compare as of_compare
from vispeg.api import diagnose as of_diagnose
from vispeg.api import fit as of_fit
from vispeg.api.recording.record import record
from vispeg.cli.main import main
from vispeg.core.errors import UserError
from vispeg.diagnosis.resolve import available, fitted_in, resolve
from vispeg.recordings.cell import WrenchSensor
from vispeg.recordings.load import load
from vispeg.recordings.recording import Control
from vispeg.recordings.write import write
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
def whole(tmp_path_factory):
    """Two recordings with joint torques, a known controller, a wrench that feels nothing, and frames."""
    options = {"size": (64, 48), "fps": 0.3, "rate_hz": 100.0, "look": "S/1"}
    rec = load(record("peg-cell", "look", **options).save(tmp_path_factory.mktemp("whole") / "a"))
    rng = np.random.default_rng(0)
    ft = rng.normal(0.0, np.repeat([0.1, 0.005], 3), (len(rec.time), 6))
    rec = replace(rec, ft=ft, wrench=WrenchSensor(), noise={**rec.noise, "ft": 0.1, "ft_torque": 0.005})
    return rec, replace(rec, path=rec.path.with_name("b"), q=rec.q + rng.normal(0.0, 2e-5, rec.q.shape))


def kept(rec, what):
    """The recording with no more than this; a torque sensor alone does not make a controller known."""
    if "torque" not in what:
        rec = replace(rec, tau=None, torque_sensor="none")
    if "control" not in what:
        rec = replace(rec, control=Control("unknown", rec.rate_hz), q_cmd=None, dq_cmd=None)
    if "wrench" not in what:
        rec = replace(rec, ft=None, wrench=None)
    return rec if "frames" in what else replace(rec, frames=None)


def answers(model, both, sides, tmp_path, monkeypatch):
    """Who -> the channels that it resolves for one model and recordings."""
    out = {}

    def heard(who, module):
        real = resolve

        def ask(*args, **options):
            out[who] = real(*args, **options)
            raise Asked

        monkeypatch.setattr(module, "resolve", ask)

    for who, module in (("diagnose", of_diagnose), ("compare", of_compare), ("fit", of_fit), ("page", of_study)):
        heard(who, module)
    effects = ["viscous_friction:joint1"]
    calls = {
        "diagnose": lambda: of_diagnose.diagnose(model, *both),
        "compare": lambda: of_compare.compare(model, list(both)),
        "fit": lambda: of_fit.fit(model, both[0], effects, both[1]),
        "page": lambda: of_study.Study(lambda *_: None, model, sides[:1], sides[1:], tmp_path / "page", 1),
    }
    for call in calls.values():
        with pytest.raises(Asked):
            call()
    judged = {"diagnose": ["--validate"], "compare": ["--recording"], "fit": ["--effects", *effects, "--validate"]}
    for command, more in judged.items():
        with pytest.raises(Asked):
            here = ["--recording", str(sides[0]), *more, str(sides[1])]
            main([command, model, *here, "--out", str(tmp_path / command), "--quiet"])
        out[f"vispeg {command}"] = out[command]
    return out


@pytest.mark.parametrize("case", CASES)
def test_all_look_in_the_same_channels(whole, case, tmp_path, monkeypatch):
    model, what, there, used = CASES[case]
    both = tuple(kept(rec, what) for rec in whole)
    sides = tuple(write(rec, tmp_path / name) for rec, name in zip(both, "ab", strict=True))
    world = of_diagnose.read_inputs(model, *both).world
    assert available(world, both) == there
    assert resolve(world, both) == used
    assert set(answers(model, both, sides, tmp_path, monkeypatch).values()) == {used}


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
