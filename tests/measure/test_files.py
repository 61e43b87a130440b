"""A measurement's file gives the measurement back, and goes into a model and a world as it is."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
import yaml

from vispeg.cli.main import main
from vispeg.core.effect import EffectInstance
from vispeg.core.params import Value
from vispeg.task.world_file import load_world
from vispeg.worlds.identified import without_interval
from vispeg.worlds.measurement_file import Measurement, load_measurement, measurement_text
from vispeg.worlds.model_file import load_model


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(4)
    angles = np.round(17.2 + 0.4 * rng.standard_normal(12), 1)
    rows = "".join(f"{place},{angle}\n" for place, angle in zip(np.repeat([1, 2, 3], 4), angles, strict=True))
    (tmp_path / "slides.csv").write_text("place,angle_deg\n" + rows)
    (tmp_path / "mass.csv").write_text("mass_g\n410\n411\n410\n412\n411\n")
    return tmp_path


def friction(*more):
    return main(["measure", "friction", "slides.csv", "--resolution", "angle_deg=0.1", "--out", "mu.yaml", *more])


def test_the_file_gives_the_measurement_back(here):
    assert friction("--conditions", "surface=steel", "temperature=21") == 0
    found = load_measurement("mu.yaml")
    (here / "again.yaml").write_text(measurement_text(found))
    assert load_measurement("again.yaml") == found
    assert found.conditions == {"surface": "steel", "temperature": "21"}
    assert found.raw["slides.csv"].startswith("sha256:")
    assert {"command", "seed", "versions"} <= set(found.provenance)
    q = found.results[0]
    assert q.u**2 == pytest.approx(sum(row.contribution**2 for row in q.budget))
    assert (q.low, q.high) == pytest.approx((q.value - q.k * q.u, q.value + q.k * q.u))


def test_its_interval_is_the_width_of_a_world_s_distribution(here):
    assert friction("--nominal", "0.3") == 0
    (here / "w.yaml").write_text("format: vispeg-world/1\nbase: nominal\nmodel: mu.yaml\n")
    (scale,) = (r.params["scale"] for r in load_world("w.yaml").world.ranges if r.effect == "contact_friction")
    q = load_measurement("mu.yaml").results[0]
    assert (scale.mean, scale.sd) == pytest.approx((q.value / 0.3, (q.high - q.low) / 0.3 / 3.92))


def test_the_cell_s_own_friction_is_what_it_is_a_multiple_of(here):
    assert friction("--world", "nominal") == 0
    q, placed = load_measurement("mu.yaml").results[0], load_measurement("mu.yaml").effects[0]
    nominal = q.value / placed.params["scale"].value
    assert nominal == pytest.approx(0.3)  # task.friction of the cell


def test_a_mass_goes_into_a_model_with_its_interval(here, capsys):
    assert main(["measure", "mass", "mass.csv", "--resolution", "mass_g=1", "--out", "mass.yaml"]) == 0
    assert main(["add", "iiwa14", "mass.yaml", "--out", "model.yaml"]) == 0
    (payload,) = load_model("model.yaml").effects
    q = load_measurement("mass.yaml").results[0]
    assert payload.params["mass"] == Value(q.value, q.low, q.high)
    friction()
    assert main(["add", "iiwa14", "mu.yaml", "--out", "other.yaml"]) == 2
    assert "model: mu.yaml" in capsys.readouterr().err


def test_a_size_that_is_nothing_with_an_interval_leaves_the_rest_constant():
    """A mass that may be there is drawn, and where it would sit is not: that is said."""
    mass = Value(0.0, -0.05, 0.05)
    drawn = replace(
        EffectInstance.of("payload", "flange"), params=EffectInstance.of("payload", "flange").params | {"mass": mass}
    )
    assert without_interval(drawn) == ["x", "y", "z", "radius"]
    assert without_interval(EffectInstance.of("payload", "flange", mass=0.0)) == []


def test_what_nobody_measured_of_a_payload_is_named_and_takes_part_in_widen(here, capsys):
    """Its centre and radius have no interval: command, model and world say so; 0.3 of them is a standard deviation."""
    said = "payload(flange) has no interval for x, y, z, radius: the same in every episode"
    assert main(["measure", "mass", "mass.csv", "--resolution", "mass_g=1", "--out", "mass.yaml"]) == 0
    assert said in " ".join(capsys.readouterr().out.split())
    assert main(["add", "iiwa14", "mass.yaml", "--out", "model.yaml"]) == 0
    assert said in " ".join(capsys.readouterr().out.split())

    def payload(**stated):
        (here / "w.yaml").write_text(yaml.safe_dump({"format": "vispeg-world/1", "base": "nominal", "model": stated}))
        return next(r for r in load_world("w.yaml").world.ranges if r.effect == "payload")

    for file in ("mass.yaml", "model.yaml"):
        with pytest.warns(UserWarning, match="no interval for x, y, z, radius"):
            fixed = payload(file=file)
        assert fixed.source.endswith("constant: x, y, z, radius") and fixed.params["z"] == 0.05
        with pytest.warns(UserWarning, match="no interval for x, y:"):
            wide = payload(file=file, widen=0.3)
        assert (wide.params["z"].sd, wide.params["radius"].sd) == pytest.approx((0.3 * 0.05, 0.3 * 0.03))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            assert payload(file=file, widen=0).params == fixed.params


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (["--out", "mu.txt"], "ends in .yaml"),
        (["--out", "slides.yaml"], "exists already"),
        (["--out", "mu.yaml", "--where", "hand"], "has no friction that an effect scales"),
        (["--out", "mu.yaml", "--world", "nope"], "nope"),
        (["--out", "mu.yaml", "--nominal", "-1"], "not a nominal value"),
        (["--out", "mu.yaml", "--nominal", "0"], "not a nominal value"),
        (["--out", "mu.yaml", "--policy", "nope"], "nope"),
        (["--out", "mu.yaml", "--conditions", "steel"], "NAME=TEXT"),
        (["--out", "mu.yaml", "--resolution", "angle_deg=x"], "not a size"),
    ],
)
def test_bad_arguments(here, argv, said, capsys):
    (here / "slides.yaml").write_text("mine")
    code = main(["measure", "friction", "slides.csv", "--resolution", "angle_deg=0.1", *argv])
    out = capsys.readouterr()
    assert said in " ".join((out.out + out.err).split())
    assert code == 2 and not (here / "mu.yaml").exists()
    assert (here / "slides.yaml").read_text() == "mine"


def test_a_normal_force_of_0_is_refused_in_one_line(here, capsys):
    (here / "forces.csv").write_text("normal,tangential\n10,3\n0,3\n")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert main(["measure", "friction", "forces.csv", "--resolution", "normal=0.1", "--out", "f.yaml"]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "row 3" in said and "no coefficient of friction above 0" in said


@pytest.mark.parametrize("option", [["--mass", "mass.yaml"], ["--axes", "x", "z"]])
def test_what_is_for_plumb_lines_is_refused_beside_wrenches(here, option, capsys):
    down = np.array([[0, 0, -1], [0, -1, 0], [-1, 0, 0], [0, 0, 1], [0, 1, 0.5]])
    rows = np.hstack([2 * 9.81 * down, np.cross([0.0, 0.0, 0.1], 2 * 9.81 * down), down])
    np.savetxt(here / "com.csv", rows, delimiter=",", header="fx,fy,fz,tx,ty,tz,gx,gy,gz", comments="")
    assert main(["measure", "mass", "mass.csv", "--resolution", "mass_g=1", "--out", "mass.yaml"]) == 0
    assert main(["measure", "com", "com.csv", "--out", "com.yaml"]) == 0
    capsys.readouterr()
    assert main(["measure", "com", "com.csv", *option, "--out", "com2.yaml"]) == 2
    assert f"com.csv: {option[0]}: is for plumb lines" in " ".join(capsys.readouterr().err.split())
    assert not (here / "com2.yaml").exists()


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (["mass", "mass.csv", "--where", "nowhere"], "--where"),
        (["mass", "mass.csv", "--where", "peg", "--nominal", "-0.1"], "--nominal"),
        (["restitution", "mass.csv", "--where", "nowhere"], "--where: no such part"),
        (["stiffness", "mass.csv", "--where", "nowhere"], "--where: no such part"),
        (["com", "mass.csv", "--axes", "x", "x"], "--axes: not two axes"),
        (["com", "mass.csv", "--world", "nope"], "nope"),
        (["joint", "mass.csv", "--columns", "time"], "--columns: not a pair"),
        (["joint", "mass.csv", "--world", "nope"], "nope"),
    ],
)
def test_a_typo_in_an_option_is_refused_before_anything_is_read(here, argv, said, capsys):
    assert main(["measure", *argv, "--out", "out.yaml"]) == 2
    said_ = " ".join(capsys.readouterr().err.split())
    assert said in said_ and "mass.csv" not in said_
    assert not (here / "out.yaml").exists()


def test_what_is_no_measurement_is_not_replaced(here, capsys):
    (here / "mu.yaml").write_text("format: vispeg-model/1\n")
    assert friction("--overwrite") == 2
    assert "vispeg-measurement/1" in capsys.readouterr().err
    assert (here / "mu.yaml").read_text() == "format: vispeg-model/1\n"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"results": []}, "results: is empty"),
        ({"effects": {"a": 1}}, "effects: wrong effects"),
        ({"effects": [{"effect": "contact_frictoin", "where": "peg"}]}, "did you mean 'contact_friction'"),
        ({"robot": 7}, "robot: wrong robot"),
        ({"notes": "x"}, "notes: wrong notes"),
        ({"value": 1}, "value: unknown key"),
    ],
)
def test_a_damaged_file_is_refused_with_its_key(here, change, said):
    from vispeg.core.errors import UserError

    friction()
    data = yaml.safe_load((here / "mu.yaml").read_text()) | change
    (here / "bad.yaml").write_text(yaml.safe_dump(data))
    with pytest.raises(UserError, match=f"bad.yaml.*{said}"):
        load_measurement("bad.yaml")


def test_of_another_robot(here, capsys):
    friction()
    found = load_measurement("mu.yaml")
    effect = (EffectInstance.of("coulomb_friction", "joint4", torque=1.0),)
    (here / "joint.yaml").write_text(measurement_text(Measurement("joint", "joint4", found.results, effect, "panda")))
    assert main(["add", "iiwa14", "joint.yaml", "--out", "model.yaml"]) == 2
    assert "of another robot" in capsys.readouterr().err


def test_the_command_finds_the_stiffness_of_a_known_spring(tmp_path, monkeypatch):
    """Presses on a stop give the arm's compliance; on the fixture, a spring of 30 kN/m in series with it."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(4)
    rows = ["pose,on,ramp,force,depth"]
    for pose, arm in ((0, 80e3), (1, 60e3)):
        for on, compliance in ((0, 1 / arm), (1, 1 / arm + 1 / 30e3)):
            for ramp in (0, 1):
                force = np.linspace(5, 30, 12)
                depth = force * compliance + rng.normal(0, 1e-6, 12)
                rows += [f"{pose},{on},{ramp},{f:.3f},{d:.8f}" for f, d in zip(force, depth, strict=True)]
    (tmp_path / "presses.csv").write_text("\n".join(rows) + "\n")
    argv = ["measure", "stiffness", "presses.csv", "--resolution", "force=0.1", "depth=1e-6", "--nominal", "1e5"]
    assert main([*argv, "--out", "k.yaml"]) == 0
    measured = load_measurement(tmp_path / "k.yaml")
    k = measured.results[0]
    assert k.low < 30e3 < k.high and k.high - k.low < 2e3
    (effect,) = measured.effects
    assert effect.label == "contact_stiffness(fixture)" and effect.params["scale"].value == pytest.approx(k.value / 1e5)
    assert main([*argv[:-2], "--out", "c.yaml"]) == 0
    (effect,) = load_measurement(tmp_path / "c.yaml").effects
    assert effect.label == "fixture_compliance(fixture)"
    z = effect.params["z"]
    assert z.low < 1 / 30e3 < z.high and z.value == pytest.approx(1 / k.value, rel=0.01)
    assert main([*argv[:-2], "--where", "peg", "--out", "peg.yaml"]) == 0
    of_peg = load_measurement(tmp_path / "peg.yaml")
    assert not of_peg.effects and "--nominal" in of_peg.notes[-1], "a peg stands on nothing that gives way"
    assert main(["add", "peg-cell", "c.yaml", "--out", "soft.yaml"]) == 0
    (in_model,) = load_model(tmp_path / "soft.yaml").effects
    assert in_model.params["z"].value == pytest.approx(z.value)


def test_a_table_with_semicolons_is_told_what_is_expected_and_no_log_s_way_out(here, capsys):
    (here / "scale.csv").write_text("mass_g;place\n152,1;1\n152,3;2\n")
    assert main(["measure", "mass", "scale.csv", "--resolution", "mass_g=1", "--out", "m.yaml"]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "expected ',' and decimal points; of a log, `vispeg convert`" in said and not (here / "m.yaml").exists()


def test_numbers_in_refusals_and_notes_are_short(here, capsys):
    (here / "scale.csv").write_text("mass_g\n-152.1\n-152.3\n")
    assert main(["measure", "mass", "scale.csv", "--resolution", "mass_g=1", "--out", "m.yaml"]) == 2
    assert "got '-0.1521'" in " ".join(capsys.readouterr().err.split())
