"""A channel of one's own: a class in one file, and every command, the page and Python have it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from loops import pendulum, swings

import vispeg
from vispeg.channels.channel import CHANNELS, How
from vispeg.channels.resolve import available, ordered, resolve
from vispeg.channels.signal import SignalChannel
from vispeg.cli.main import main
from vispeg.core.effect import REGISTRY, EffectInstance
from vispeg.core.errors import UserError
from vispeg.diagnosis.beginning import ANEW
from vispeg.identify.excitation import motion
from vispeg.identify.record import centre_of, controller, record
from vispeg.recordings.importers.mapping import read_map
from vispeg.recordings.load import load
from vispeg.recordings.noise import NOISE
from vispeg.recordings.recording import Control, Recording, Signal, in_order
from vispeg.recordings.windows import split
from vispeg.recordings.write import write
from vispeg.robots import model
from vispeg.robots.objects import CUBE
from vispeg.view.diagnose.study import Study
from vispeg.worlds.world import World

NAME = "own_current"  # not `current`, which a channel of the package may be called
PER_AMPERE, SIGMA = 8.0, 0.03  # N m/A at the joint; A
HIDDEN = EffectInstance.of("coulomb_friction", "joint4", torque=1.5)


@pytest.fixture(scope="module", autouse=True)
def enrolled():
    """Define the class, which enrols itself, for these tests alone."""

    class Current(SignalChannel):
        """The current of each motor."""

        name = NAME

        def shows(self, kind):
            """Look for what loads a motor."""
            return kind.family in ("joint", "body") and kind.searchable and "torque" in kind.channels()

        def predict(self, response, item, worlds):
            """Return the torque of each motor in amperes."""
            return response.tau_motor / PER_AMPERE

    yield
    del CHANNELS[NAME]


@pytest.fixture(scope="module")
def sides(tmp_path_factory):
    """Two recordings of an arm whose current was measured, and no torque."""
    robot, out = model.load("iiwa14"), []
    for name, seed in (("a", 1), ("b", 2)):
        rng = np.random.default_rng(seed)
        servo = controller(robot, "position", 100.0, centre_of(robot))
        move = motion("fourier", robot, 100.0, 3.0, rng)
        quiet = {**NOISE, "tau": 0.0}
        rec = record(World("iiwa14").add(HIDDEN), move, servo, quiet, rng, name=name, torque_sensor="motor")
        values = rec.tau / PER_AMPERE + SIGMA * rng.standard_normal(rec.tau.shape)
        rec = replace(rec, tau=None, torque_sensor="none", signals={NAME: Signal(values, "A", SIGMA)})
        out.append(write(rec, tmp_path_factory.mktemp(NAME) / name))
    return out


def test_a_signal_that_is_missing_is_not_called_a_short_recording(sides):
    rec = load(sides[0])
    gone = replace(rec.signals[NAME], values=np.where(rec.time[:, None] < 0.3, rec.signals[NAME].values, np.nan))
    with pytest.raises(UserError, match="no reading after the first 0.4 s of an episode"):
        CHANNELS[NAME].evidence(World("iiwa14"), ((replace(rec, signals={NAME: gone}),), ()), How())


def test_a_signal_whose_noise_cannot_be_told_is_said_to_stand_or_to_be_read_too_rarely(sides):
    rec = load(sides[0])
    values = rec.signals[NAME].values
    row = np.arange(len(values))[:, None]
    for changed, why in (
        (np.where(np.arange(7) == 3, 0.5, values), "does not vary"),
        (np.where((np.arange(7) == 3) & (row % 4 == 0), np.nan, values), "is never read five times in a row"),
    ):
        signals = {NAME: replace(rec.signals[NAME], values=changed, noise=None)}
        with pytest.raises(UserError, match=f"{NAME}.joint4: {why}, so that its noise cannot be told"):
            CHANNELS[NAME].evidence(World("iiwa14"), ((replace(rec, signals=signals),), ()), How())


def test_a_joint_that_was_never_read_has_no_error(sides, tmp_path):
    """Its noise is stated, so that nothing need be told from the readings."""
    rec = load(sides[0])
    values = np.where(np.arange(7) == 3, np.nan, rec.signals[NAME].values)
    there = write(replace(rec, signals={NAME: replace(rec.signals[NAME], values=values)}), tmp_path / "rec")
    asked = ["compare", "iiwa14", "--recording", str(there), "--channels", NAME, "--out", str(tmp_path / "out")]
    assert main(asked) == 0
    joints = {row["joint"]: row for row in json.loads((tmp_path / "out/compare.json").read_text())["joints"]}
    assert joints["joint4"]["error"] is None and joints["joint4"]["times_floor"] is None
    assert joints["joint3"]["times_floor"] == pytest.approx(joints["joint3"]["error"] / SIGMA)


@pytest.mark.parametrize(("part", "came"), [((0,), "(300, 7)"), ((slice(None), slice(1)), "(1, 1, 7)")])
def test_a_prediction_of_the_wrong_shape_is_one_line(sides, monkeypatch, part, came):
    kind = type(CHANNELS[NAME])
    right = kind.predict
    monkeypatch.setattr(kind, "predict", lambda self, *given: right(self, *given)[part])
    evidence, _ = CHANNELS[NAME].evidence(World("iiwa14"), ((load(sides[0]),), ()), How())
    with pytest.raises(UserError) as caught:
        evidence.residuals([World("iiwa14")])
    said = str(caught.value)
    assert f"channel '{NAME}'" in said and "expected (nworld, m, nj) = (1, " in said and said.endswith(f"got {came}")


def test_it_is_looked_in_beside_the_joints(sides):
    both = [(load(side),) for side in sides]
    assert available(World("iiwa14"), *both) == resolve(World("iiwa14"), *both) == ("joints", NAME)
    bare = [(replace(rec, signals={}),) for (rec,) in both]
    assert available(World("iiwa14"), *bare) == ("joints",)
    with pytest.raises(UserError, match="have this channel"):
        resolve(World("iiwa14"), *bare, asked=(NAME,))


def test_a_free_object_has_its_tosses_alone(tmp_path):
    (tmp_path / "cube.xml").write_text(CUBE)
    assert available(World(str(tmp_path / "cube.xml"))) == ("tosses",)


def test_diagnosis_names_what_was_hidden_by_the_signal_alone(sides, tmp_path):
    out = tmp_path / "out"
    asked = ["--recording", str(sides[0]), "--validate", str(sides[1]), "--channels", NAME, "--quiet"]
    assert main(["diagnose", "iiwa14", *asked, "--out", str(out)]) == 0
    said = json.loads((out / "diagnosis.json").read_text())
    (found,) = said["effects"]
    assert (said["verdict"], found["effect"], found["where"]) == ("identified", HIDDEN.effect, HIDDEN.where)
    torque = found["params"]["torque"]
    assert torque["low"] < 1.5 < torque["high"] and abs(torque["value"] - 1.5) < 0.05
    assert said["noise_floor"] == {"value": pytest.approx(SIGMA), "unit": "A RMS", "from": "stated noise"}
    assert said["ladder"][-1]["heldout_error"] == pytest.approx(SIGMA, rel=0.1)
    assert any(row["effect"] == "payload" for row in said["shows_from"])
    page = (out / "report.html").read_text()
    assert "A RMS" in page and "signal residual" in page
    again = vispeg.compare(out / "model.yaml", [sides[1]], channels=[NAME])
    assert again.error == pytest.approx(said["ladder"][-1]["heldout_error"], rel=1e-9), "command and comparison agree"


def test_a_partial_effect_is_fitted_anew_by_the_signal_alone(sides):
    wrong = replace(HIDDEN.with_values(torque=1.0), partial=True)
    found = vispeg.diagnose(World("iiwa14").add(wrong), sides[0], sides[1], channels=NAME)
    (torque,) = (e.params["torque"] for e in found.effects)
    assert torque.low < 1.5 < torque.high and found.verdict == "identified"
    assert [rung["model"] for rung in found.record["ladder"]] == ["nominal", ANEW]


def test_joints_propose_the_next_motion_also_beside_another_channel(tmp_path):
    """The mount of a pendulum rattles at 7 Hz, which no effect explains and the current does not show."""
    out, t = [], np.arange(600) / 200.0
    for i, rec in enumerate(swings(World(), 3, 3.0)):
        current = Signal(np.zeros_like(rec.q), "A", 1e6)
        rattle = 2e-3 * np.sin(2 * np.pi * 7.0 * t + i)[:, None]
        out.append(replace(rec, q=rec.q + rattle, path=Path("abc"[i]), signals={NAME: current}))
    found = vispeg.diagnose(World(pendulum().source), out[:2], out[2:], channels=["joints", NAME], threads=1)
    assert [row["channel"] for row in found.record["by_channel"]] == ["joints", NAME]
    assert found.verdict == "unexplained" and found.record["next_experiment"]["motion"] == "triangle"
    found.save(tmp_path / "found")
    moves = np.loadtxt(tmp_path / "found" / found.record["next_experiment"]["file"], delimiter=",", skiprows=1)
    assert moves[:, 1] == pytest.approx(found.arrays["next/q_cmd"][:, 0], rel=1e-8)  # nine digits
    assert (
        "next/time" in np.load(tmp_path / "found/evidence.npz")
        and "triangle" in (tmp_path / "found/report.html").read_text()
    )


def test_a_fit_by_it_agrees_with_the_joints(sides):
    ways = [
        vispeg.fit("iiwa14", sides[0], ["coulomb_friction:joint4"], sides[1], channels=[name])
        for name in ("joints", NAME)
    ]
    for way in ways:
        (torque,) = (e.params["torque"] for e in way.effects)
        assert torque.low < 1.5 < torque.high
    assert [way.record["channel"] for way in ways] == ["joints", NAME]


def test_a_comparison_has_both_and_the_page_goes_step_by_step(sides, tmp_path):
    said = vispeg.compare("iiwa14", [sides[1]])
    (other,) = said.record["by_channel"]
    rows = {row["joint"]: row["times_floor"] for row in other["record"]["joints"]}
    assert other["channel"] == NAME and max(rows, key=rows.get) == "joint4" and rows["joint4"] > 3
    page = Study(lambda *said: None, "iiwa14", (sides[0],), (sides[1],), tmp_path, 1, NAME)
    page.show()
    before = page.standing()
    assert before.channels == ("joints", NAME) and before.unit == "A" and np.isfinite(before.ladder[0].error)
    page.fit("coulomb_friction:joint4")
    after = page.standing()
    assert [e.words for e in after.effects] == ["Coulomb friction in joint 4"]
    assert after.ladder[-1].error == pytest.approx(SIGMA, rel=0.1)


def test_a_signal_is_kept_bit_for_bit_cut_with_the_samples_and_put_in_order(sides, tmp_path):
    rec = load(sides[0])
    again = load(write(rec, tmp_path / "again")).signals[NAME]
    mine = rec.signals[NAME]
    assert np.array_equal(again.values, mine.values) and (again.unit, again.noise) == (mine.unit, mine.noise)
    first, last = (part.signals[NAME].values for part in split(rec, 0.25))
    assert np.array_equal(np.vstack([first, last]), mine.values)
    turned = in_order(rec, rec.joints[::-1])
    assert np.array_equal(turned.signals[NAME].values, mine.values[:, ::-1])


def test_what_a_header_declares_must_be_there(sides, tmp_path, capsys):
    header = sides[0] / "recording.yaml"
    text, samples = header.read_text(), (sides[0] / "samples.csv").read_text()
    for name, header_text, samples_text, expected in (
        ("none", text.replace(f"{NAME}:", "heat:"), samples, "heat.joint1"),
        ("taken", text.replace(f"{NAME}:", "tau:"), samples, "cannot name a signal of one's own"),
        ("unit", text.replace("unit: A", "unit: ''"), samples, f"signals.{NAME}.unit"),
        ("column", text, samples.replace(f"{NAME}.joint3", "other"), f"{NAME}.joint3"),
    ):
        folder = tmp_path / name
        folder.mkdir()
        (folder / "recording.yaml").write_text(header_text)
        (folder / "samples.csv").write_text(samples_text)
        with pytest.raises(UserError) as caught:
            load(folder)
        assert expected in str(caught.value), name
    out = ["--out", str(tmp_path / "out")]
    assert main(["compare", "iiwa14", "--recording", str(sides[0]), "--channels", "amperes", *out]) == 2
    said = capsys.readouterr().err
    names = [channel.name for channel in ordered()]
    assert "unknown channel" in said and f"choices: {', '.join(names)};" in said and {"joints", NAME} < {*names}


def test_a_log_with_it_comes_in_by_a_map(sides, tmp_path):
    """The same readings from a table of other names and units."""
    rec, table = load(sides[0]), tmp_path / "log.csv"
    columns = {"t": rec.time} | {f"angle{j}": q for j, q in enumerate(rec.q.T)}
    columns |= {f"i{j}": 1e3 * v for j, v in enumerate(rec.signals[NAME].values.T)}
    np.savetxt(
        table, np.column_stack([*columns.values()]), delimiter=",", header=",".join(columns), comments="", fmt="%.17g"
    )
    lines = [f"q.{joint}: angle{j}\n{NAME}.{joint}: {{column: i{j}, unit: mA}}" for j, joint in enumerate(rec.joints)]
    header = f"recording: {{signals: {{{NAME}: {{unit: A, noise: 0.03}}}}}}\n"
    (tmp_path / "map.yaml").write_text("\n".join(["time: t", *lines, header]))
    vispeg.convert(table, "iiwa14", tmp_path / "out", mapping=tmp_path / "map.yaml")
    again = load(tmp_path / "out").signals[NAME]
    assert np.allclose(again.values, rec.signals[NAME].values, rtol=1e-12) and again.unit == "A"


@pytest.mark.parametrize(
    ("stated", "unit", "factor"), [("A", "mA", 1e-3), ("mA", "mA", 1.0), ("mA", "A", 1e3), ("degC", "degC", 1.0)]
)
def test_a_map_brings_readings_into_the_unit_that_the_header_states(sides, tmp_path, capsys, stated, unit, factor):
    """The values and the unit that stands beside them agree, also where the unit is none that is known."""
    rec, table = load(sides[0]), tmp_path / "log.csv"
    columns = {"t": rec.time} | {f"angle{j}": q for j, q in enumerate(rec.q.T)} | {"i": rec.time + 20.0}
    np.savetxt(table, np.column_stack([*columns.values()]), delimiter=",", header=",".join(columns), comments="")
    lines = [f"q.{joint}: angle{j}\n{NAME}.{joint}: {{column: i, unit: {unit}}}" for j, joint in enumerate(rec.joints)]
    header = f"recording: {{signals: {{{NAME}: {{unit: {stated}, noise: 0.03}}}}}}\n"
    (tmp_path / "map.yaml").write_text("\n".join(["time: t", *lines, header]))
    asked = [str(table), "--robot", "iiwa14", "--map", str(tmp_path / "map.yaml"), "--out", str(tmp_path / "out")]
    assert main(["convert", *asked]) == 0
    assert capsys.readouterr().out.rstrip().endswith(f"q, {NAME}")
    signal = load(tmp_path / "out").signals[NAME]
    np.testing.assert_allclose(signal.values[:, 0], factor * (rec.time + 20.0), rtol=1e-9)
    assert signal.unit == stated


def test_a_map_refuses_a_unit_of_another_quantity(tmp_path):
    text = f"{NAME}.joint1: {{column: i, unit: deg}}\nrecording: {{signals: {{{NAME}: {{unit: A}}}}}}\n"
    (tmp_path / "map.yaml").write_text(text)
    with pytest.raises(UserError, match="cannot be brought into A, the unit of this signal.*choices: A, mA"):
        read_map(tmp_path / "map.yaml", ["joint1"])


def test_python_takes_the_name_of_one_channel(sides):
    whole = vispeg.compare("iiwa14", sides[1], channels=[NAME])
    assert vispeg.compare("iiwa14", sides[1], channels=NAME).error == whole.error
    fitted = vispeg.fit("iiwa14", sides[0], ["coulomb_friction:joint4"], sides[1], channels=NAME)
    assert fitted.record["channel"] == NAME
    with pytest.raises(UserError, match="unknown channel; got 'amperes'"):
        vispeg.diagnose("iiwa14", sides[0], sides[1], channels="amperes")


def test_a_name_is_one_channels(sides):
    with pytest.raises(UserError, match="channel 'joints' is registered twice"):
        type("Other", (type(CHANNELS["joints"]),), {"name": "joints"})


@pytest.mark.parametrize("name", sorted(CHANNELS))
def test_every_channel_keeps_the_contract(name):
    """The part of a model that a channel shows stays as it is; recordings without its signal do not have it."""
    channel, world = CHANNELS[name], World("iiwa14").add(HIDDEN)
    part = channel.part(world)
    assert channel.part(part) == part and all(e in world.effects for e in part.effects)
    joints, time = tuple(f"joint{k}" for k in range(1, 8)), np.arange(40) / 100
    bare = Recording(Path("bare"), "iiwa14", joints, 100.0, Control("unknown"), time, np.zeros((40, 7)))
    assert not channel.has(world, [bare])
    assert any(map(channel.shows, REGISTRY.values())) and not all(map(channel.shows, REGISTRY.values()))


def test_every_effect_is_looked_for_somewhere_but_chance():
    nowhere = {name for name, kind in REGISTRY.items() if not any(c.shows(kind) for c in CHANNELS.values())}
    assert nowhere == {"torque_noise", "encoder_noise", "dropped_readings", "goal_imprecision"}
