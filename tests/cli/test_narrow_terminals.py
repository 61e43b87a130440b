"""In a narrow terminal and in a pipe every number, name and interval is whole: real processes, own widths."""

import json
import os
import re
import subprocess
import sys

import pytest

from vispeg.core.effect import REGISTRY
from vispeg.report.drawings.ladder import ladder_rows
from vispeg.report.sections.found import effect_rows
from vispeg.report.text.catalogue import GROUPS
from vispeg.report.text.terminal import _record, joints_table

WIDTHS = [None, 80, 60]  # None: a pipe of which nothing is said


def run(*args, columns=None, cwd=None):
    """Standard output of `vispeg ARGS`, a pipe."""
    environment = {k: v for k, v in os.environ.items() if k != "COLUMNS"}
    if columns is not None:
        environment["COLUMNS"] = str(columns)
    command = [sys.executable, "-m", "vispeg", *map(str, args)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=cwd, stdin=subprocess.DEVNULL)
    assert done.returncode == 0, done.stderr
    return done.stdout


def within(text, columns):
    return [line for line in text.splitlines() if len(line) > (columns or 80) and "/" not in line]


def whole(text, parts):
    """Parts that no line has in one piece, between blanks."""
    lines = text.splitlines()
    return [p for p in parts if p and not any(re.search(rf"(?<!\S){re.escape(p)}(?!\S)", line) for line in lines)]


@pytest.mark.parametrize("columns", WIDTHS)
def test_the_list_of_effects(columns):
    text = run("effects", columns=columns)
    assert not within(text, columns)
    assert not whole(text, REGISTRY) and re.findall(r"^# (\w+)", text, re.M) == list(GROUPS)
    ends = [f"{p.low:g} to {p.high:g}" for kind in REGISTRY.values() for p in kind.params.values()]
    assert not [e for e in ends if not any(e in line for line in text.splitlines())]


@pytest.mark.parametrize("columns", WIDTHS[1:])
def test_one_effect(columns):
    text = run("effects", "stribeck_friction", columns=columns)
    assert not within(text, columns) and not whole(text, ["coulomb", "excess", "velocity", "rad/s", "0.005", "shape"])


def test_compare(rigs, tmp_path):
    text = run("compare", "iiwa14", "--recording", rigs["short"], "--out", "c", columns=60, cwd=tmp_path)
    record = json.loads((tmp_path / "c" / "compare.json").read_text())
    assert not within(text, 60) and not whole(text, [cell for row in joints_table(record).rows for cell in row])


PRINTING = """
import json, sys, pathlib
from vispeg.report.fitted import fit_summary
from vispeg.report.text.summary import print_summary
from vispeg.report.text.terminal import comparison_summary, diagnosis_summary, written_lines
record = json.loads(sys.stdin.read())
print_summary(comparison_summary(record))
print_summary([*diagnosis_summary(record), *written_lines(record, pathlib.Path("out"))])
print_summary(fit_summary(record))
"""


@pytest.mark.parametrize("columns", WIDTHS)
def test_what_compare_fit_diagnose_and_demo_print(columns):
    """As a process prints what took them seconds to minutes to find."""
    small = {"value": -7.237e-7, "low": -2.836e-6, "high": 1.389e-6, "unit": "m"}
    friction = {"effect": "coulomb_friction", "where": "joint4", "params": {"torque": {"value": 1.2}}, "without": 12.34}
    friction["explains"] = 0.9321
    joint = {"joint": "joint7", "error": 1.234e-4, "floor": 2.04e-5, "unit": "rad RMS", "torque_error": 0.236}
    record = {
        "verdict": "identified",
        "effects": [
            {"effect": "payload", "where": "flange", "params": {"y": small, "mass": {"value": 15.0}}},
            friction,
        ],
        "ladder": [
            {"model": "+ coulomb_friction(joint4)", "fit_error": 4.72e-5, "heldout_error": 4.01e-5, "unit": "rad RMS"}
        ],
        "joints": [{**joint, "times_floor": 6.05}],
        "noise_floor": {"value": 2.04e-5, "unit": "rad RMS"},
        **{"chi2": 1.0, "converged": True, "at_bound": [], "unidentifiable": [], "hardly_told_apart": []},
        **{"starts": [], "notes": []},
    }
    environment = {**os.environ, "COLUMNS": "" if columns is None else str(columns)}
    command = [sys.executable, "-c", PRINTING]
    done = subprocess.run(command, input=json.dumps(record), capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    cells = [row[k] for row in effect_rows(_record(record)) for k in ("value", "interval", "unit", "bound")]
    cells += [row[k] for row in ladder_rows(_record(record)) for k in ("model", "fit", "heldout", "floor")]
    cells += [cell for row in joints_table(record).rows for cell in row]
    cells += ["93.2 % of the excess", "12 × the noise floor"]
    assert len(cells) > 15 and "at its bound" in cells
    assert not within(done.stdout, columns) and not whole(done.stdout, cells)


def test_a_ladder_of_effects_that_came_in_together_stays_a_table(capsys):
    """At 80 columns, whatever many effects a step added: a row a model, its errors beside it."""
    from rich.console import Console

    from vispeg.report.text.terminal import ladder_table

    together = "+ coulomb_friction + viscous_friction + rotor_inertia + joint_bias(several)"
    rungs = [
        {"model": m, "fit_error": 4.72e-5, "heldout_error": 1e-3, "unit": "rad RMS"} for m in ("nominal", together)
    ]
    Console(width=80).print(ladder_table({"ladder": rungs, "noise_floor": {"value": 2e-5, "unit": "rad RMS"}}))
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80 and lines[0].split() == ["Model", "Fitted", "Held", "out", "×", "floor"]
    names = [line.split("  ")[0].strip() for line in lines[2:]]
    assert names == ["nominal", "+ coulomb_friction", "+ viscous_friction", "+ rotor_inertia", "+ joint_bias(several)"]
    assert "1.00 mrad RMS" in lines[3]


def test_many_effects_stay_a_table_of_a_line_each(capsys):
    """At 80 columns: effect and place, value with its unit, interval and name; of a law each parameter below it."""
    from rich.console import Console

    from vispeg.report.text.terminal import effects_table

    def placed(name, where, **more):
        params = {
            k: {"value": 11.2, "low": 11.188, "high": 11.213, "unit": p.unit} for k, p in REGISTRY[name].params.items()
        }
        return {"effect": name, "where": where, "params": params} | more

    joints = [f"joint{j}" for j in range(1, 8)]
    effects = [placed(name, joint) for joint in joints for name in ("coulomb_friction", "viscous_friction")]
    effects += [placed("joint_bias", joint, tentative=True) for joint in joints[:5]]
    sheet = effects_table({"verdict": "identified", "effects": effects})
    with_law = effects_table({"verdict": "identified", "effects": [*effects, placed("stribeck_friction", "joint1")]})
    assert sheet.width() > 80, "else nothing is shortened"
    Console(width=80).print(sheet)
    lines = [line.rstrip() for line in capsys.readouterr().out.splitlines()]
    assert len(lines) == 2 + 19 and max(map(len, lines)) <= 80
    assert lines[2].split("  ")[0] == "coulomb_friction(joint1)" and "11.200 N m" in lines[2] and "named" in lines[2]
    assert sum(line.endswith("tentative") for line in lines) == 5
    Console(width=80).print(with_law)
    law = [line.rstrip() for line in capsys.readouterr().out.splitlines()][-4:]
    assert [line.split()[0] for line in law] == ["stribeck_friction(joint1)", *REGISTRY["stribeck_friction"].params]
    assert "rad/s" in law[-1] and "11.188 to 11.213" in law[-1]


@pytest.mark.parametrize("columns", [20, 40, 60, 80, 200])
def test_no_cell_is_cut_off(columns, capsys, monkeypatch):
    """Sentences in columns that do not wrap, as the steps of `explain` have, and a word wider than the terminal."""
    from vispeg.report.text.summary import print_summary
    from vispeg.report.text.tables import Column, Sheet

    hours = "0.83 h: 50 of 1 min (stated); training not counted, its time is not known"
    rows = [["50 demonstrations on the robot, fine-tune", hours, "one\ntwo"], ["record", "/a/path" * 20, "60"]]
    monkeypatch.setenv("COLUMNS", str(columns))
    print_summary([Sheet([Column(head) for head in ("next step", "hours", "points an hour")], rows)])
    said = capsys.readouterr().out
    assert not whole(said, [word for row in rows for cell in row for word in cell.split()])


def test_check(rigs):
    text = run("check", rigs["short"], columns=60)
    said = text.partition("  !")[0].splitlines()[1:]  # warnings are sentences, one a line
    assert not within("\n".join(said), 60) and not whole(text, [f"joint{i}" for i in range(1, 8)])
    assert len(re.findall(r"^  top speed rad/s +\d\.\d\d$", text, re.M)) == 7
    assert "e+0" not in text


def test_cameras(tmp_path):
    from vispeg.render.cameras.camera_files import save_cameras
    from vispeg.render.cameras.standard import standard_cameras

    save_cameras(tmp_path / "camera.yaml", standard_cameras()[:1])
    text = run("camera", "show", "camera.yaml", columns=60, cwd=tmp_path)
    assert not within(text, 60) and not whole(text, ["wrist_wide", "64x64", "75x75", "flange"])
