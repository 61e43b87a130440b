"""No command with --out and --overwrite takes what it reads, or what this program did not write."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from vispeg.cli.command import leaves
from vispeg.cli.main import main
from vispeg.core.assets import assets
from vispeg.evaluation.records import Episode
from vispeg.evaluation.suite import summarise
from vispeg.trials.trial import _example as example

ROOT = Path(__file__).parents[2]
# Each command that replaces something, with an input at data/INPUT. What is run is this with --overwrite and --out.
READS = {
    "check": "check data/rig",
    "convert": "convert data/log.csv --map data/log.yaml --robot iiwa14",
    "compare": "compare iiwa14 --recording data/rig",
    "diagnose": "diagnose iiwa14 --recording data/rig --validate data/rig2",
    "fit": "fit iiwa14 --recording data/rig --effects joint_bias:joint1",
    "fit paper": "fit data/model.yaml --recording data/osc --protocol paper",
    "record": "record data/model.yaml --motion fourier --duration 1",
    "camera calibrate": "camera calibrate data/images --pattern 9x6 --square 0.02",
    "camera place": "camera place data/tags.csv --robot iiwa14",
    "render": "render --world data/w.yaml --frames 4 --workers 0",
    "dataset show": "dataset show data/frames",
    "dataset export": "dataset export data/frames",
    "train": "train peg-state --world data/w.yaml --recipe distill --teacher data/policy --films 0",
    "play": "play data/policy --episodes 1",
    "finetune": "finetune data/policy --world nominal --demos 1 --updates 1 --episodes 1",
    "combine": "combine data/policy data/policy",
    "evaluate": "evaluate data/policy --episodes 1 --videos 0",
    "gap": "gap data/policy --worlds nominal --episodes 1 --videos 0",
    "suite run": "suite run data/policy --train nominal --target randomized --episodes 1",
    "suite compare": "suite compare data/suite",
    "sensitivity": "sensitivity data/policy --sweep latency --episodes 1",
    "exploit": "exploit data/policy --episodes 1",
    "explain": "explain data/trials --policy data/policy --replays 1",
    "perturb": "perturb data/policy --episodes 1",
    "demo": "demo",
    "measure joint": "measure joint data/rig --joint joint4",
    "measure plan": "measure plan joint4",
}
MEASURED = {f"measure {quantity}" for quantity in ("mass", "com", "friction", "restitution", "stiffness")}
FILES = {"add", "export", "motions", "measure zeros", *MEASURED}  # these write one file, see below
OTHERS = {"effects", "report"}  # these write one file of a name of their own into a folder
WHY = (
    "is read by this command|holds .* which this command reads|has no .vispeg.json|not a folder of such results|a file"
)
HEAD = "format: vispeg-world/1\nbase: nominal\n"


def test_every_command_that_replaces_something_is_tried_here():
    there = {name for name, command in leaves().items() if {"out", "overwrite"} <= command.taken().keys()}
    assert there == {*READS, *FILES, *OTHERS} - {"fit paper"}


@pytest.fixture(scope="module")
def original(tmp_path_factory) -> Path:
    """A folder of a user's: recordings, a log, a world, a dataset, a policy, images, results."""
    root = tmp_path_factory.mktemp("original")
    data = root / "data"
    record = ["record", "iiwa14", "--duration", "1", "--motion"]
    assert main([*record, "fourier", "--out", str(data / "rig")]) == 0
    assert main([*record, "fourier", "--seed", "1", "--out", str(data / "rig2")]) == 0
    assert main(["record", "iiwa14", "--motion", "osc", "--out", str(data / "osc")]) == 0
    assert main(["add", "iiwa14", "payload", "flange", "--out", str(data / "model.yaml")]) == 0
    frames = ["--frames", "4", "--size", "32", "--workers", "0", "--no-labels"]
    assert main(["render", "--world", "nominal", *frames, "--out", str(data / "frames")]) == 0
    shutil.copytree(assets() / "policies" / "state-3mm", data / "policy")
    shutil.copy(data / "rig" / "samples.csv", data / "log.csv")
    (data / "log.yaml").write_text("time: time\n" + "".join(f"q.joint{n}: q.joint{n}\n" for n in range(1, 8)))
    (data / "w.yaml").write_text(HEAD)
    (data / "images").mkdir()
    (data / "images" / "1.png").write_bytes(b"\x89PNG")
    (data / "suite").mkdir()
    worlds = {"here": "0", "there": "1"}
    played = [
        Episode("p", "state", 0, w, h, n, True, "success", configuration="c") for w, h in worlds.items() for n in (1, 2)
    ]
    (data / "suite" / "suite.json").write_text(
        json.dumps(summarise(played, "here", "there", "1", worlds) | {"notes": []})
    )
    (data / "mass.csv").write_text("mass_g\n101\n102\n101\n")
    (data / "tags.csv").write_text("joint1,joint2\n0,0\n")
    (data / "notes.txt").write_text("mine")
    (data / "trials").mkdir()
    example(data / "trials")
    return root


@pytest.fixture
def data(original, tmp_path, monkeypatch) -> Path:
    shutil.copytree(original, tmp_path / "work")
    monkeypatch.chdir(tmp_path / "work")
    return tmp_path / "work" / "data"


def tree(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.mark.parametrize("name", READS)
def test_what_a_command_reads_survives_it(name, data, capsys):
    command = READS[name].split()
    read = [word for word in command if word.startswith("data/")]
    (data.parent / "link").symlink_to(data)
    outs = [*dict.fromkeys(read), "data", "link", "data/../data", str(data), "strangers"]
    (data.parent / "strangers" / "deep").mkdir(parents=True)
    (data.parent / "strangers" / "deep" / "thesis.tex").write_text("years")
    before = tree(data.parent)
    for out in outs:
        code = main([*command, "--out", out, "--overwrite"])
        said = capsys.readouterr().err.strip().splitlines()
        assert code == 2 and said[-1].startswith("vispeg: error: ") and re.search(WHY, said[-1]), (out, said)
        assert tree(data.parent) == before, out


def test_single_files_are_replaced_only_by_their_like(data, capsys):
    before = tree(data)
    for command in (
        "add iiwa14 payload flange --out data/rig/recording.yaml",
        "add iiwa14 payload flange --out data/w.yaml",
        "export data/policy --out data/policy/policy.safetensors",
        "export data/policy --out data/notes.txt",
        "motions fourier --out data/log.csv",
        "measure zeros data/mass.csv --robot iiwa14 --out data/model.yaml",
        *(f"{command} data/mass.csv --out data/model.yaml" for command in sorted(MEASURED)),
    ):
        assert main([*command.split(), "--overwrite"]) == 2, command
        assert tree(data) == before
    assert main("add data/model.yaml payload flange --set mass=1 --out data/model.yaml --overwrite".split()) == 0
    motion = "motions fourier --duration 1 --out data/motion.csv".split()
    assert main(motion) == 0 and main(motion) == 2 and main([*motion, "--overwrite"]) == 0


def test_the_same_command_may_replace_what_it_wrote(data, capsys):
    command = "record iiwa14 --motion fourier --duration 1 --out again".split()
    assert main(command) == 0 and main(command) == 2 and main([*command, "--overwrite"]) == 0
    assert main("compare iiwa14 --recording data/rig --out again --overwrite".split()) == 2
    assert "another kind of result (recording, not comparison)" in capsys.readouterr().err
    (data.parent / "again" / "mine.txt").write_text("x")
    assert main([*command, "--overwrite"]) == 2 and "mine.txt" in capsys.readouterr().err


def test_files_beside_an_export_are_outputs_too(vispeg, refused, tmp_path):
    """Meshes of the user's in the folder that an export would fill are replaced on request alone."""
    assert vispeg("export", "iiwa14", "--to", "urdf", "--out", "first.urdf")[0] == 0
    for mesh in (tmp_path / "first-meshes").iterdir():
        (tmp_path / "arm-meshes").mkdir(exist_ok=True)
        (tmp_path / "arm-meshes" / mesh.name).write_bytes(b"mine")
    mine = sorted((tmp_path / "arm-meshes").iterdir())
    refused(["export", "iiwa14", "--to", "urdf", "--out", "arm.urdf"], "arm-meshes", "--overwrite")
    assert all(path.read_bytes() == b"mine" for path in mine)
    assert vispeg("export", "iiwa14", "--to", "urdf", "--out", "arm.urdf", "--overwrite")[0] == 0
    again = {path.name: path.read_bytes() for path in (tmp_path / "arm-meshes").iterdir()}
    assert again == {path.name: path.read_bytes() for path in (tmp_path / "first-meshes").iterdir()}
    (tmp_path / "arm.urdf").unlink()  # what is there with the same bytes is no conflict
    assert vispeg("export", "iiwa14", "--to", "urdf", "--out", "arm.urdf")[0] == 0


HOLD = """
import sys, time
from vispeg.core.lock import claimed
with claimed(sys.argv[1]):
    print("held", flush=True)
    time.sleep(600)
"""


def test_what_another_process_writes_is_left_to_it(data, capsys):
    """Every command that writes a folder takes its lock before it works."""
    out = data.parent / "taken"
    before = tree(data.parent)
    held = [sys.executable, "-c", HOLD, str(out)]
    with subprocess.Popen(held, stdout=subprocess.PIPE, text=True, cwd=ROOT) as process:
        assert process.stdout is not None and process.stdout.readline() == "held\n"
        for name, command in READS.items():
            assert main([*command.split(), "--out", str(out)]) == 2, name
            said = capsys.readouterr().err.strip().splitlines()[-1]
            assert "writes it since" in said and str(out) in said, (name, said)
        process.kill()
    assert {k: v for k, v in tree(data.parent).items() if k != ".taken.lock"} == before
