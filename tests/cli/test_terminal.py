"""The terminal: lists of what there is, one JSON object or list each, help in people's words, completion with Tab."""

import json
import os
import re
import shutil
import subprocess
import sys

import pytest

from vispeg.cli.main import main
from vispeg.cli.overview import COMMANDS
from vispeg.core.effect import REGISTRY
from vispeg.core.errors import UserError

SUB = [("camera", "calibrate"), ("camera", "show"), ("dataset", "show"), ("dataset", "check"), ("dataset", "export")]
SUB += [("suite", "run"), ("suite", "compare"), ("measure", "mass")]
LEAVES = [(c,) for c in COMMANDS if c not in {sub[0] for sub in SUB}] + SUB


@pytest.mark.parametrize("command", LEAVES, ids="-".join)
def test_help_speaks_in_peoples_words(command, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    assert main([*command, "--help"]) == 0
    text = capsys.readouterr().out
    assert "--json" in text and "--quiet" in text
    usage = text[: text.index("\n\n")] + "".join(line for line in text.splitlines(True) if "--" in line[:12])
    assert not re.search(r"\b(STR|INT|FLOAT|None|False)\b", usage), usage
    assert "(default: None)" not in text and "(default: False)" not in text and "(default: )" not in text


def test_many_options_stand_under_headings(capsys):
    assert main(["train", "--help"]) == 0
    under, heading = {}, ""
    for line in capsys.readouterr().out.splitlines():
        if line.startswith("╭"):
            heading = line.split()[1]
        elif line.startswith("│ --"):
            under[line.split()[1]] = heading
    found = [under[option] for option in ("--world", "--teacher", "--films", "--out")]
    assert found == ["task", "imitation", "evaluation", "options"]


NARROW = [(), ("measure",), ("train",), ("diagnose",), ("dataset", "show")]


@pytest.mark.parametrize(
    ("command", "columns"),
    [*((command, 80) for command in sorted({*LEAVES, *((sub[0],) for sub in SUB)})), *((some, 40) for some in NARROW)],
)
def test_help_fits_the_terminal_but_for_commands_to_copy(command, columns, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(columns))
    assert main([*command, "--help"]) == 0
    text = capsys.readouterr().out
    wide = [line for line in text.splitlines() if len(line) > columns]
    assert not [line for line in wide if not line.startswith(("    ", "  vispeg "))]


def test_a_sub_commands_help_is_its_own(capsys):
    assert main(["measure", "mass", "--help"]) == 0
    text = capsys.readouterr().out
    assert text.count("Measure a mass by a scale.") == 1 and "restitution" not in text


@pytest.mark.parametrize("command", ["worlds", "policies", "motions", "robots"])
def test_lists(vispeg, command, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    code, out, _ = vispeg(command)
    assert code == 0 and max(map(len, out.splitlines())) <= 80
    (key, rows), *others = json.loads(vispeg(command, "--json")[1]).items()
    assert key == command and not others
    assert len(rows) >= 5 and all(row["name"] in out and len(row["about"]) > 10 for row in rows)
    family = rows[0]["family"]
    some = json.loads(vispeg(command, "--family", family, "--json")[1])
    assert some == {command: [r for r in rows if r["family"] == family]}
    named = json.loads(vispeg(command, "--search", rows[-1]["name"], "--json")[1])[command]
    assert named.count(rows[-1]) == 1
    code, out, err = vispeg(command, "--family", "nonesuch")
    assert code == 2 and f"choices: {', '.join(sorted({r['family'] for r in rows}))}" in err


def test_what_is_listed_can_be_named(monkeypatch):
    monkeypatch.delenv("MENAGERIE_ROOT", raising=False)
    monkeypatch.setitem(sys.modules, "mujoco_menagerie", None)  # not installed
    from vispeg.api.library import catalogue
    from vispeg.evaluation.entrants import entrant
    from vispeg.learn.shipped import policy_folder
    from vispeg.task.world_file import load_world

    for entry in catalogue.worlds():
        try:
            ranges = load_world(entry.name).world.ranges
        except UserError as error:  # of an arm that is not installed
            assert "MuJoCo Menagerie" in entry.about and "'menagerie'" in str(error), entry.name
            continue
        assert (entry.family == "randomized") == bool(ranges), entry.name
    with pytest.raises(UserError) as refused:
        load_world("nonesuch")
    assert str(refused.value).endswith(f"choices: {', '.join(entry.name for entry in catalogue.worlds())}")
    assert all(policy_folder(entry.name).is_dir() for entry in catalogue.policies())
    for entry in catalogue.policies():
        who, world = entrant(entry.name), load_world(str(entry.more["world"]))
        assert (" as it was before" in entry.about) == (world.hash not in who.trained_on), entry.name


def test_effects_by_family_and_by_words(vispeg):
    rows = json.loads(vispeg("effects", "--family", "drive", "--json")[1])["effects"]
    assert {r["name"] for r in rows} == {n for n, e in REGISTRY.items() if e.family == "drive"}
    assert {"stribeck_friction"} <= {
        r["name"] for r in json.loads(vispeg("effects", "--search", "Stribeck", "--json")[1])["effects"]
    }
    assert vispeg("effects", "payload", "--search", "x")[0] == 2


def completed(script, *words):
    line = " ".join(f"'{w}'" for w in words)
    asked = f"source {script}; COMP_WORDS=({line}); COMP_CWORD={len(words) - 1}; _vispeg"
    test = asked + '; printf "%s\\n" "${COMPREPLY[@]}"'
    return subprocess.run(["bash", "-c", test], capture_output=True, text=True, check=True).stdout.splitlines()


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
def test_the_shell_completes_commands_options_choices_and_names(vispeg, tmp_path):
    script = tmp_path / "vispeg.bash"
    script.write_text(vispeg("completion", "bash")[1])
    for folder in ("depth-mine", "my rig"):
        (tmp_path / folder).mkdir()
    assert completed(script, "vispeg", "co") == [c for c in COMMANDS if c.startswith("co")] != []
    assert completed(script, "vispeg", "train", "--recipe", "d") == ["distill", "distill+sac"]
    assert {"depth-S", "depth-S2"} <= set(completed(script, "vispeg", "evaluate", "depth"))
    assert {"V", "VNP"} == set(completed(script, "vispeg", "gap", "--worlds", "V"))
    assert completed(script, "vispeg", "camera", "cal") == ["calibrate"]
    assert completed(script, "vispeg", "camera", "calibrate", "--mo") == ["--mount"]
    assert completed(script, "vispeg", "record", "iiwa14", "--motion", "tri") == ["triangle"]
    assert {"depth-mine", "--out"} <= set(completed(script, "vispeg", "explain", "--quiet", ""))
    assert "--recording" in completed(script, "vispeg", "diagnose", "--json", "--")
    assert completed(script, "vispeg", "check", "my") == ["my rig"]
    assert completed(script, "vispeg", "help", "tr") == ["train"]
    # the second value of an option of several, after which another option may come; the only value of another option
    assert {"V", "VNP"} == set(completed(script, "vispeg", "gap", "--worlds", "S", "V"))
    assert completed(script, "vispeg", "diagnose", "iiwa14", "--recording", "a", "--va") == ["--validate"]
    assert completed(script, "vispeg", "record", "--motion", "tap", "iiw") == ["iiwa14"]
    assert completed(script, "vispeg", "record", "--seed", "my") == [""], "a number"
    for given, wanted in (((), ["distill", "distill+sac", "sac"]), (("d",), ["distill", "distill+sac"])):  # --recipe=d
        assert sorted(completed(script, "vispeg", "train", "--recipe", "=", *given)) == wanted
    assert completed(script, "vispeg", "record", "peg") == ["peg-cell"]  # and --recipe=d in one word, as zsh has it
    assert completed(script, "vispeg", "train", "--recipe=d") == [
        "--recipe=distill",
        "--recipe=distill+sac",
    ]  # one word
    code, out, _ = vispeg("completion", "zsh")
    assert code == 0 and all(name in out for name in COMMANDS)
    if shutil.which("zsh"):
        subprocess.run(["zsh", "-n"], input=out, text=True, check=True)


@pytest.mark.skipif(shutil.which("fish") is None, reason="no fish")
def test_fish_completes_commands_options_choices_names_and_files(vispeg, tmp_path):
    (tmp_path / "vispeg.fish").write_text(vispeg("completion", "fish")[1])
    (tmp_path / "my rig").mkdir()
    (tmp_path / "depth-mine").mkdir()
    lines = {
        "vispeg co": {c for c in COMMANDS if c.startswith("co")},
        "vispeg help tr": {"train"},
        "vispeg camera c": {"calibrate"},
        "vispeg camera show c": set(),
        "vispeg camera calibrate --mo": {"--mount"},
        "vispeg train --recipe d": {"distill", "distill+sac"},
        "vispeg train --recipe=d": {"--recipe=distill", "--recipe=distill+sac"},
        "vispeg record iiwa14 --motion tri": {"triangle"},
        "vispeg record iiwa14 --out=m": {"--out=my rig/"},
        "vispeg record --seed m": set(),
        "vispeg record --motion tap pe": {"peg-cell"},
        "vispeg gap --worlds S V": {"V", "VNP"},
        "vispeg diagnose iiwa14 --recording a --va": {"--validate"},
        "vispeg check m": {"my rig/"},
        "vispeg check d": {"depth-mine/"},
    }
    asked = "\n".join(f"echo '= {line}'; complete -C '{line}'" for line in lines)
    command = ["fish", "--private", "-c", f"source vispeg.fish\n{asked}"]
    home = {**os.environ, "HOME": str(tmp_path / "home"), "XDG_CONFIG_HOME": str(tmp_path / "home")}
    said = subprocess.run(command, capture_output=True, text=True, check=True, cwd=tmp_path, env=home).stdout
    found = {part.split("\n")[0]: {*part.split("\n")[1:]} - {""} for part in said.split("= ")[1:]}
    assert found == lines


def test_one_object_and_nothing_else(vispeg, rigs):
    code, out, err = vispeg("compare", "iiwa14", "--recording", rigs["nominal"], "--out", "c", "--json", "--quiet")
    assert code == 0 and json.loads(out)["format"] == "vispeg-compare/1" and err == ""
    code, out, _ = vispeg("add", "iiwa14", "coulomb_friction", "joint4", "--out", "m.yaml", "--json")
    assert code == 0 and json.loads(out)["added"][0]["where"] == "joint4"
    code, out, _ = vispeg("record", "m.yaml", "--motion", "triangle", "--duration", "2", "--out", "r", "--json")
    assert code == 0 and json.loads(out)["samples"] == 1000
