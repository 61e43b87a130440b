"""The command line: quick help, an example for each command, one line and the right exit code for each failure."""

import os
import subprocess
import sys
from ast import literal_eval
from pathlib import Path

import pytest

from vispeg import __version__
from vispeg.cli import main as cli
from vispeg.cli.overview import COMMANDS, doc, installed
from vispeg.core.errors import UserError

ROOT = Path(__file__).parents[2]
HEAVY = {"torch", "matplotlib", "plotly", "pyarrow", "rosbags", "trimesh", "cv2", "ray"}
FAKE = '''import warnings

from vispeg.cli.command import command
from vispeg.core.errors import UserError

@command()
def fake(call, how: str = "well"):
    """Do nothing.

    Example:
        vispeg fake --how usererror

    Args:
        how: what happens.
    """
    if how == "usererror":
        raise UserError("two\\nlines", file="f.yaml", got=1)
    if how == "interrupt":
        raise KeyboardInterrupt
    if how == "warn":
        warnings.warn("odd\\n  column")
    if how == "three":
        return 3
    if how == "wrong":
        return 1 // 0
'''


def python(*command: str, **options) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, *command], cwd=ROOT, capture_output=True, text=True, timeout=120, **options)


@pytest.fixture
def fake(tmp_path, monkeypatch):
    (tmp_path / "fake_command.py").write_text(FAKE)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setitem(COMMANDS, "fake", "fake_command:fake")
    yield
    sys.modules.pop("fake_command", None)


def test_overview_imports_nothing_that_takes_time():
    code = "import sys; from vispeg.cli.main import main; main(['--help']); print(sorted(sys.modules), file=sys.stderr)"
    loaded = set(literal_eval(python("-c", code).stderr))
    assert not loaded & (HEAVY | {"numpy", "mujoco", "scipy", "tyro", "rich", "yaml", "pydantic"})


def test_no_command_imports_heavy_packages_before_it_runs():
    code = "import importlib, sys; from vispeg.cli.overview import COMMANDS, installed\n"
    code += (
        "for name in installed(): importlib.import_module(COMMANDS[name].partition(':')[0])\nprint(sorted(sys.modules))"
    )
    assert not set(literal_eval(python("-c", code).stdout)) & HEAVY


def test_every_promised_command_is_there():
    assert installed() == list(COMMANDS)


@pytest.mark.parametrize("name", installed())
def test_help_of_each_command_has_a_summary_and_an_example(name, capsys):
    assert cli.main([name, "--help"]) == 0
    shown = capsys.readouterr()
    assert f"usage: vispeg {name}" in shown.out
    assert "xample" in shown.out and f"vispeg {name}" in shown.out.split("xample", 1)[1]
    line = doc(COMMANDS[name]).partition("\n")[0]
    assert 10 < len(line) and line in cli.overview(), "the first line is what `vispeg --help` shows"


def test_the_overview_fits_80_columns():
    assert max(map(len, cli.overview().splitlines())) <= 80


def test_nearest_sub_command_is_suggested(capsys):
    assert cli.main(["dataset", "show2"]) == 2
    assert "did you mean 'show'" in capsys.readouterr().err


@pytest.mark.parametrize(
    "argv", [["nope"], ["diagnoze"], ["--nope"], ["doctor", "--nope"], ["camera"], ["demo", "--seed", "x"], []]
)
def test_usage_errors_exit_2(argv, capsys):
    assert cli.main(argv) == 2
    said = capsys.readouterr().err
    assert said == "" or (said.startswith("vispeg: error: ") and said.count("\n") == 1)


def test_nearest_command_is_suggested(capsys):
    cli.main(["doctr"])
    assert "did you mean 'doctor'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (("evaluate", "expert", "--wolrd", "S"), "--wolrd, S (did you mean --world?)"),
        (("gap", "expert", "--world", "S", "--out", "g"), "or --worlds?)"),
        (("train", "peg-depth", "--modality", "depth"), "in the name of its task, as in TASK-depth"),
    ],
)
def test_nearest_option_is_suggested_without_its_help(argv, said, capsys):
    assert cli.main(list(argv)) == 2
    err = capsys.readouterr().err
    assert said in err and len(err) < 220 and err.count("\n") == 1


def test_the_parsers_frame_is_taken_off_where_the_terminal_writes_ascii_alone():
    env = {**os.environ, "PYTHONIOENCODING": "ascii"}
    said = (
        python("-m", "vispeg", "doctor", "--nope", env=env).stderr
        + python("-m", "vispeg", "demo", "--seed", "x", env=env).stderr
    )
    assert "--nope" in said and "--seed" in said and "---" not in said and said.count("\n") == 2


def test_version(capsys):
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out == f"vispeg {__version__}\n"


@pytest.mark.parametrize(
    ("how", "code", "said"),
    [
        ("well", 0, ""),
        ("three", 3, ""),
        ("usererror", 2, "vispeg: error: f.yaml: two lines; got 1\n"),
        ("interrupt", 130, "vispeg: interrupted; to begin again: vispeg fake --how interrupt\n"),
    ],
)
def test_exit_codes(fake, capsys, how, code, said):
    assert cli.main(["fake", "--how", how]) == code
    assert capsys.readouterr().err == said


def test_warnings_are_one_line_notes(tmp_path):
    (tmp_path / "fake_command.py").write_text(FAKE)
    code = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); from vispeg.cli.main import main\n"
    code += "from vispeg.cli.overview import COMMANDS\n"
    code += "COMMANDS['fake'] = 'fake_command:fake'; sys.exit(main(['fake', '--how', 'warn']))"
    done = python("-c", code)
    assert (done.returncode, done.stderr) == (0, "vispeg: note: odd column\n")


def test_a_programming_error_is_not_hidden(fake):
    with pytest.raises(ZeroDivisionError):
        cli.main(["fake", "--how", "wrong"])
    assert not issubclass(UserError, ArithmeticError)


def test_a_reader_that_goes_away_is_no_error():
    command = [sys.executable, "-m", "vispeg", "--help"]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout is not None and process.stderr is not None
    process.stdout.close()
    error = process.stderr.read()
    process.stderr.close()
    assert (process.wait(60), error) == (141, b"")


@pytest.mark.parametrize(
    ("chosen", "words"),
    [("bogus", ("MUJOCO_GL", "bogus", "egl, osmesa")), ("osmesa", ("MUJOCO_GL", "libOSMesa.so.8", "libosmesa6"))],
)
def test_a_renderer_that_is_not_there_is_one_line(chosen, words, tmp_path):
    """In a process of its own, whose loader finds no OSMesa, as on a machine that has none."""
    code = (
        "import ctypes, sys\n"
        "load = ctypes.CDLL.__init__\n"
        "def without(self, name, *more, **options):\n"
        "    if 'OSMesa' in str(name): raise OSError('no such library')\n"
        "    load(self, name, *more, **options)\n"
        "ctypes.CDLL.__init__ = without\n"
        "import vispeg\n"
        "try: vispeg.make\n"
        "except vispeg.UserError as error: python = str(error)\n"
        "from vispeg.cli.main import main\n"
        "code = main(['render', '--world', 'nominal', '--frames', '1', '--out', 'out'])\n"
        "print(python)\n"
        "sys.exit(code)\n"
    )
    env = {**os.environ, "MUJOCO_GL": chosen, "PYTHONPATH": str(Path(__file__).parents[2])}
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=env, capture_output=True, text=True)
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1 and not list(tmp_path.iterdir()), done.stderr
    assert all(word in done.stderr for word in words), done.stderr
    assert done.stderr == f"vispeg: error: {done.stdout}", "the same line in Python"
