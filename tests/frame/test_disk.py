"""A disk that is full or not to be written: one line, exit 2, nothing lost, and the command goes on later."""

import os
import re
import resource
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.outcomes import results
from vispeg.cli.main import main

ROOT = Path(__file__).resolve().parents[2]
RECORD = "record iiwa14 --motion fourier --duration 1 --out"
RENDER = "render --world nominal --frames 4 --size 32 --workers 0 --no-labels --out"
SHORT = {
    "train": "train peg-state --steps 64 --every 32 --envs 4 --episodes 2 --films 0 --quiet --out OUT",
    "record": f"{RECORD} OUT",
    "record-parquet": f"{RECORD} OUT --table parquet",
    "render": f"{RENDER} OUT",
    "evaluate": "evaluate expert --episodes 2 --videos 0 --out OUT",
}
LONG = {
    "fit": "fit iiwa14 --recording rig --effects joint_bias:joint2 --iterations 1 --quiet --out OUT",
    "compare": "compare iiwa14 --recording rig --out OUT",
    "check": "check rig --out OUT",
    "diagnose": "diagnose iiwa14 --recording rig --validate rig2 --quiet --out OUT",
    "effects": "effects coulomb_friction --out OUT",
    "bop": f"{RENDER} OUT --format bop",
    "dataset-show": "dataset show frames --out OUT",
    "dataset-export": "dataset export frames --out OUT",
    "gap": "gap expert --worlds nominal unknown_hole --controls --episodes 2 --videos 1 --quiet --out OUT",
    "suite": "suite run expert --train nominal --target randomized --episodes 1 --quiet --out OUT",
    "sensitivity": "sensitivity expert --sweep latency --episodes 1 --quiet --out OUT",
    "exploit": "exploit expert --episodes 2 --quiet --out OUT",
    "perturb": "perturb expert --episodes 1 --quiet --out OUT",
    "combine": "combine depth-S state-0.5mm --out OUT",
    "play": "play state-3mm --episodes 1 --out OUT",
    "finetune": "finetune state-3mm --world nominal --demos 2 --updates 2 --episodes 2 --out OUT",
}
LIMITS = (0, 300, 3_000, 30_000)  # bytes that a file can have


def call(command, out, capsys, limit=None):
    """Exit code and standard error of a command that writes `out`, where no file can be longer than `limit`."""
    capsys.readouterr()
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        if limit is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
        code = main(command.replace("OUT", out).split())
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    return code, capsys.readouterr().err


def refused_then_done(command, limits, tmp_path, capsys):
    assert call(command, "whole", capsys)[0] == 0
    stopped = []
    for limit in limits:
        before = {p for p in tmp_path.rglob("*") if p.is_file()}
        code, err = call(command, "killed", capsys, limit)
        if code == 0:  # no file was that long
            shutil.rmtree("killed")
            continue
        stopped.append(limit)
        lines = err.strip().splitlines()
        assert code == 2 and len(lines) == 1, err
        assert lines[0].startswith("vispeg: error: ") and "killed" in lines[0], err
        assert not re.search(r"[0-9a-f]{8}\.part", lines[0]), "a name that the user never sees"
        left = {p for p in tmp_path.rglob("*") if p.is_file()} - before
        assert not [p for p in left if p.name.endswith((".lock", ".part")) or re.search("[0-9a-f]{8}.part", str(p))], (
            left
        )
    assert stopped
    code, err = call(command, "killed", capsys)
    assert code == 0, err
    assert results(tmp_path / "killed") == results(tmp_path / "whole")


@pytest.fixture
def inputs(tmp_path, monkeypatch, capsys):
    """Recordings, and a dataset if asked for, in the folder where the commands run."""
    monkeypatch.chdir(tmp_path)

    def make(command):
        for seed, name in enumerate(("rig", "rig2")):
            if name in command.split():
                assert main([*f"{RECORD} {name}".split(), "--seed", str(seed)]) == 0
        if "frames" in command.split():
            assert main([*RENDER.split(), "frames"]) == 0
        return command

    return make


@pytest.mark.parametrize("name", SHORT)
def test_a_full_disk_is_one_line_and_the_command_goes_on_later(name, inputs, tmp_path, capsys):
    refused_then_done(inputs(SHORT[name]), (300,), tmp_path, capsys)


@pytest.mark.slow
@pytest.mark.parametrize("name", [*SHORT, *LONG])
def test_a_disk_that_is_full_at_any_moment(name, inputs, tmp_path, capsys):
    refused_then_done(inputs({**SHORT, **LONG}[name]), LIMITS, tmp_path, capsys)


MOUNTED = """
import os, subprocess, sys
from vispeg.cli.main import main
disk = sys.argv[1]
def said(args):
    code = main(args.split())
    print("exit", code, file=sys.stderr, flush=True)
record, evaluate = "record iiwa14 --motion fourier --duration 1", "evaluate expert --episodes 2 --videos 0"
subprocess.run(["mount", "-t", "tmpfs", "-o", "size=32k", "none", disk], check=True)
said(f"export iiwa14 --to mjcf --out {disk}/arm.xml")
said(f"{record} --out {disk}/rig")
print(os.listdir(disk), file=sys.stderr)
subprocess.run(["mount", "-o", "remount,ro", disk], check=True)
said(f"{record} --out {disk}/rig")
said(f"{evaluate} --out {disk}/judged")
said(f"add iiwa14 payload flange --out {disk}/model.yaml")
os.dup2(os.open("/dev/full", os.O_WRONLY), 1)
said("effects")
"""


def test_real_disks_that_are_full_and_read_only(tmp_path):
    command = ["unshare", "--user", "--map-root-user", "--mount"]
    if shutil.which("unshare") is None or subprocess.run([*command, "true"], capture_output=True).returncode:
        pytest.skip("this machine lets nobody mount a small disk")
    (tmp_path / "disk").mkdir()
    run = [*command, sys.executable, "-c", MOUNTED, "disk"]
    done = subprocess.run(
        run, cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True
    )
    lines = done.stderr.splitlines()
    full, read_only = "cannot be written: No space left on device", "Read-only file system"
    assert lines[0].startswith("vispeg: error: disk/arm-meshes/") and lines[0].endswith(full), done.stderr
    assert lines[1:5] == ["exit 2", f"vispeg: error: disk/rig: {full}", "exit 2", "[]"], done.stderr
    assert lines[5::2] == [
        f"vispeg: error: disk/{name}: cannot be written: {read_only}" for name in ("rig", "judged", "model.yaml")
    ] + [f"vispeg: error: {full}"]
    assert lines[6::2] == ["exit 2"] * 4 and done.returncode == 0
