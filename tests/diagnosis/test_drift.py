"""A robot that has not changed is said not to; one that has, in what, and since when."""

import json

import pytest

from vispeg.cli.main import main

WHOLE = "coulomb_friction:joint4:torque=1.2 viscous_friction:joint2:damping=4"
WORN = "coulomb_friction:joint4:torque=1.25 viscous_friction:joint2:damping=4"


@pytest.fixture(scope="module")
def days(tmp_path_factory):
    """A model, and recordings of seven days; on the fifth and after it joint 4 has a twentieth more friction."""
    place = tmp_path_factory.mktemp("days")
    for day in range(8):
        motion = ("fourier", "triangle")[day % 2]
        effects = (WORN if day > 4 else WHOLE).split()
        how = ["--motion", motion, "--duration", "2", "--seed", str(day), "--effects", *effects]
        assert main(["record", "iiwa14", *how, "--out", str(place / f"day-{day}"), "--quiet", "--json"]) == 0
    effects = ["coulomb_friction:joint4", "viscous_friction:joint2"]
    how = ["--recording", str(place / "day-0"), "--effects", *effects, "--out", str(place / "fit"), "--quiet", "--json"]
    assert main(["fit", "iiwa14", *how]) == 0
    return place


def compared(days, numbers, out, capsys, model="fit/model.yaml"):
    recordings = [word for k in numbers for word in ("--recording", str(days / f"day-{k}"))]
    assert main(["compare", str(days / model), *recordings, "--out", str(out), "--quiet"]) == 0
    return json.loads((out / "compare.json").read_text()), " ".join(capsys.readouterr().out.split())


@pytest.mark.slow
def test_a_robot_that_has_not_changed_is_said_not_to(days, tmp_path, capsys):
    record, said = compared(days, (1, 2, 3, 4), tmp_path / "same", capsys)
    assert "has the robot changed? no: all 2 values agree in 4 recordings with the identified model" in said
    assert {row["since"] for row in record["drift"]} == {None}
    for row in record["drift"]:
        truth = {"torque": 1.2, "damping": 4.0}[row["parameter"]]
        assert sum(n["low"] <= truth <= n["high"] for n in row["now"]) >= 3, "each recording's interval holds the truth"


def test_what_has_changed_is_named_with_the_first_recording_that_shows_it(days, tmp_path, capsys):
    record, said = compared(days, (3, 4, 5, 6, 7), tmp_path / "worn", capsys)
    since = {row["effect"]: row["since"] for row in record["drift"]}
    assert since == {"coulomb_friction": "day-5", "viscous_friction": None}
    assert "coulomb_friction(joint4) torque 1.20" in said and "outside since day-5" in said
    (row,) = (r for r in record["drift"] if r["since"])
    assert [n["outside"] for n in row["now"]] == [False, False, True, True, True]
    assert row["now"][-1]["value"] == pytest.approx(1.25, abs=0.01)
    page = (tmp_path / "worn" / "report.html").read_text()
    assert "Has the robot changed?" in page and "outside since day-5" in page


@pytest.mark.slow
def test_a_model_without_intervals_asks_nothing(days, tmp_path, capsys):
    text = (days / "fit" / "model.yaml").read_text()
    bare = [line for line in text.splitlines() if not line.strip().startswith(("low:", "high:"))]
    (days / "bare.yaml").write_text("\n".join(bare))
    record, said = compared(days, (1,), tmp_path / "bare", capsys, model="bare.yaml")
    assert "drift" not in record and "has the robot changed" not in said
