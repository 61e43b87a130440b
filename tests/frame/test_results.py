"""A result in Python: opened again it is what was saved; short to print, drawn, tabulated; errors name arguments."""

import numpy as np
import pytest

import vispeg
from vispeg.core.assets import assets

RIGS = assets() / "recordings"


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Kind -> (result, folder it was saved in)."""
    out = tmp_path_factory.mktemp("results")
    world = vispeg.World("iiwa14").add("payload", "flange", mass=0.5)
    rigs = [vispeg.load_recording(RIGS / name, seconds=3) for name in ("rig-a", "rig-c")]
    made = {
        "compare": vispeg.compare(world, rigs[0], threads=1),
        "fit": vispeg.fit("iiwa14", rigs[0], ["coulomb_friction:joint4"], rigs[1], iterations=2, threads=1),
        "evaluate": vispeg.evaluate("expert", episodes=2),
    }
    return {kind: (result, result.save(out / kind)) for kind, result in made.items()}


@pytest.mark.parametrize("kind", ["compare", "fit", "evaluate"])
def test_a_saved_result_is_opened_again(results, kind):
    result, folder = results[kind]
    again = vispeg.load(folder)
    assert type(again) is type(result) and str(again) == str(result)
    assert len(repr(result)) < 200 and repr(result).startswith(f"<{type(result).__name__}: ")
    assert "\n" not in repr(result) and "\x1b" not in repr(result) + str(result)
    table = again.to_pandas()
    assert len(table) and table.equals(result.to_pandas())
    if kind == "fit":
        assert [e.label for e in again.effects] == [e.label for e in result.effects] == ["coulomb_friction(joint4)"]


def test_a_notebook_gets_the_same_text_and_nothing_beside_it(results, monkeypatch, capsys):
    """Inside Jupyter rich would colour the text and show an output of its own."""
    plain = {kind: (str(result), repr(result)) for kind, (result, _) in results.items()}
    monkeypatch.setattr("rich.console._is_jupyter", lambda: True)
    monkeypatch.setattr("rich.jupyter.display", lambda *_: pytest.fail("an output of its own"))
    assert {kind: (str(result), repr(result)) for kind, (result, _) in results.items()} == plain
    assert capsys.readouterr() == ("", "")


def test_pictures_of_results(results):
    figure = results["compare"][0].plot()
    lines = [line for line in figure.axes[0].get_lines() if len(line.get_xdata()) > 10]
    measured = results["compare"][0].arrays["0/measured"][:, 0]
    assert any(np.isclose(np.nanmax(line.get_ydata()), measured.max(), atol=1e-3) for line in lines)
    for number in (-1, 99):
        with pytest.raises(vispeg.UserError, match="no such recording"):
            results["compare"][0].plot(number)
    figure = results["fit"][0].plot()
    assert figure.axes and figure._repr_png_().startswith(b"\x89PNG"), "a notebook shows it without pyplot"
    axes = results["evaluate"][0].plot().axes[0]
    success = results["evaluate"][0].record["success"][0]["success"]
    assert [*axes.lines[0].get_xdata()] == [100 * success["low"], 100 * success["high"]]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["expert in nominal"]


def test_a_world_takes_an_effect_by_its_name():
    by_name = vispeg.World("iiwa14").add("coulomb_friction", "joint4", torque=1.3)
    assert by_name.values == {"coulomb_friction(joint4)": {"torque": 1.3}}
    for bad in (("coulomb_friction",), ("coulomb_friction", "joint4", "joint5")):
        with pytest.raises(vispeg.UserError, match="name and its place"):
            vispeg.World("iiwa14").add(*bad)
    with pytest.raises(vispeg.UserError, match="coulomb_friction"):
        vispeg.World("iiwa14").add("coulomb_frictoin", "joint4")


def test_errors_name_arguments_in_python_and_options_in_commands(tmp_path, capsys):
    from vispeg.cli.main import main

    with pytest.raises(vispeg.UserError, match="^validate: .*hold_out 0.3") as error:
        vispeg.diagnose("iiwa14", RIGS / "rig-a")
    assert "--" not in str(error.value)
    assert main(["diagnose", "iiwa14", "--recording", str(RIGS / "rig-a"), "--out", str(tmp_path / "d")]) == 2
    assert "--validate: " in capsys.readouterr().err
    with pytest.raises(vispeg.UserError, match="^validate"):
        vispeg.diagnose("iiwa14", RIGS / "rig-a")


def test_what_the_face_gives_is_short_to_print():
    """A notebook's last line, or a debugger, shows a value in one line that tells which one it is."""
    world = vispeg.World("iiwa14").add("coulomb_friction", "joint4", torque=1.3)
    assert repr(world) == "<World: iiwa14, coulomb_friction(joint4, torque=1.3)>"
    recording = vispeg.load_recording(RIGS / "rig-a", seconds=3)
    assert "iiwa14, 7 joints" in repr(recording) and "tau" in repr(recording)
    for value in (world, recording, vispeg.load_world("S"), vispeg.load_world("S").world, vispeg.check(RIGS / "rig-a")):
        assert len(repr(value)) < 200 and "\n" not in repr(value)


def test_one_thing_stands_for_a_list_of_it(tmp_path):
    made = vispeg.record("iiwa14", "fourier", duration=1.5, effects="coulomb_friction:joint4:torque=1.3").save(
        tmp_path / "rig"
    )
    assert vispeg.check(made).reports == vispeg.check([str(made)]).reports
    played = vispeg.gap("expert", "nominal", episodes=1, controls="none")
    assert [w["name"] for w in played.record["worlds"]] == ["nominal"]
    for wrong in (
        lambda: vispeg.evaluate("expert", controls="blindd"),
        lambda: vispeg.gap("expert", controls="blindd"),
    ):
        with pytest.raises(vispeg.UserError, match="got 'blindd'"):
            wrong()


def test_a_seed_that_is_none_is_refused_before_work(tmp_path):
    with pytest.raises(vispeg.UserError, match="^seed: .* from 0 to .*; got -1"):
        vispeg.diagnose("iiwa14", tmp_path / "not-read", tmp_path / "neither", seed=-1)
    with pytest.raises(vispeg.UserError, match="^seed: "):
        vispeg.fit("iiwa14", tmp_path / "not-read", seed=-1)
