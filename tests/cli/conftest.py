"""The command line called as a user calls it, and short recordings made by it."""

import os
from pathlib import Path

import pytest

from vispeg.cli.main import main


@pytest.fixture
def vispeg(capsys, tmp_path, monkeypatch):
    """Runs a command in an empty folder; returns (exit code, standard output, standard error)."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "120")

    def run(*args):
        capsys.readouterr()
        code = main([str(a) for a in args])
        out, err = capsys.readouterr()
        return code, out, err

    return run


@pytest.fixture
def refused(vispeg, tmp_path):
    """Runs a command that must end with 2, one line that has all of `words`, and nothing written."""

    def run(args, *words):
        before = sorted(p for p in tmp_path.rglob("*"))
        code, out, err = vispeg(*args)
        assert code == 2 and out == "", (code, out, err)
        lines = err.strip().splitlines()
        assert len(lines) == 1 and lines[0].startswith("vispeg: error: "), err
        assert all(word in lines[0] for word in words), lines[0]
        assert sorted(p for p in tmp_path.rglob("*")) == before

    return run


@pytest.fixture(scope="session")
def rigs(tmp_path_factory) -> dict[str, Path]:
    """Recordings of 2 s: two of an arm with friction in joint4, one of the nominal arm, one under osc."""
    root = tmp_path_factory.mktemp("rigs")
    hidden = ["--effects", "coulomb_friction:joint4:torque=1.2"]
    commands = {
        "friction": ["--motion", "fourier", "--seed", "1", *hidden],
        "friction2": ["--motion", "fourier", "--seed", "2", *hidden],
        "nominal": ["--motion", "triangle"],
        "short": ["--motion", "fourier", "--duration", "1.2"],
        "osc": ["--motion", "osc", "--effects", "link_mass:link4:mass=0.8", "viscous_friction:joint4:damping=2"],
    }
    here = os.getcwd()
    for name, args in commands.items():
        args = args if "--duration" in args else [*args, "--duration", "2"]
        assert main(["record", "iiwa14", "--out", str(root / name), *args]) == 0
    assert os.getcwd() == here
    return {name: root / name for name in commands}
