"""Long commands killed at any moment go on to the results that they would have had; interrupted, they say how."""

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

from tests.outcomes import results

ROOT = Path(__file__).resolve().parents[2]
RECORD = "record iiwa14 --motion fourier --duration 1 --out"
THREE = """
format: vispeg-suite/1
name: three
configurations:
  - {name: as it is}
  - {name: clearance 1 mm, task: {clearance_mm: 1.0}}
  - {name: late, effects: [{effect: command_delay, params: {delay: 0.02}}]}
"""
# The command, and what is appended to go on. QUICK ones die at a given write, in CI; all die at random times, slowly.
FIT = "fit iiwa14 --recording rig --effects stribeck_friction:joint4 --iterations 2 --quiet --out OUT"
QUICK = {
    "fit": (FIT, "--resume"),
    "render": ("render --world nominal --frames 6 --size 32 --workers 0 --no-labels --out OUT", ""),
    "evaluate": ("evaluate expert --world unknown_hole --episodes 3 --videos 0 --out OUT", ""),
}
ALL = {
    **QUICK,
    "fit-cma": ("fit iiwa14 --recording rig --effects backlash:joint2 --iterations 2 --quiet --out OUT", "--resume"),
    "fit-starts": (f"{FIT} --starts 3 --validate rig2", "--resume"),
    "diagnose": ("diagnose iiwa14 --recording rig --validate rig2 --quiet --out OUT", ""),
    "record": ("record iiwa14 --motion fourier --duration 20 --out OUT", ""),
    "render-workers": ("render --world nominal --frames 100 --size 48 --workers 2 --out OUT", ""),
    "evaluate-workers": ("evaluate expert --world randomized --episodes 60 --workers 2 --videos 1 --out OUT", ""),
    "gap": ("gap expert --worlds nominal unknown_hole --controls --episodes 24 --videos 1 --out OUT", ""),
    "suite": (
        "suite run expert --suite three.yaml --train nominal --target randomized --version 1 --episodes 8 --out OUT",
        "",
    ),
    "sensitivity": ("sensitivity expert --sweep latency --episodes 8 --out OUT", ""),
    "exploit": ("exploit expert --episodes 20 --out OUT", ""),
    "perturb": ("perturb expert --episodes 4 --out OUT", ""),
    "train": ("train peg-state --steps 2600 --every 650 --utd 0.1 --envs 4 --episodes 4 --films 0 --out OUT", ""),
    "distill": (
        "train peg-state --recipe distill --teacher expert --distill-steps 200 --distill-updates 40 --episodes 4 "
        "--films 0 --out OUT",
        "",
    ),
    "finetune": (
        "finetune state-3mm --world nominal --demos 4 --updates 20 --episodes 8 --out OUT",
        "",
    ),
}
WRITES = {
    "fit": (2,),
    "render": (1, 3),
    "evaluate": (1,),
}  # of the program, at which it is killed: each file and folder that takes its name is one
DYING = """
import os, signal, sys
from vispeg.cli.main import main
last, replace = int(sys.argv[1]), os.replace
def dying(*names):
    global last
    last -= 1
    if last == 0:
        os.kill(os.getpid(), signal.SIGKILL)
    replace(*names)
os.replace = dying
sys.argv = ["vispeg", *sys.argv[2:]]
sys.exit(main())
"""


def start(command: str, *before: str, **options) -> subprocess.Popen:
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    program = [sys.executable, *(before or ("-m", "vispeg")), *command.split()]
    pipes = {"stderr": subprocess.PIPE, "stdout": subprocess.DEVNULL}
    return subprocess.Popen(program, env=environment, preexec_fn=_interruptible, **pipes, **options)


def _interruptible() -> None:
    """Whoever began the tests in the background ignores interrupts, and what ignores them hands that down."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def finish(command: str) -> None:
    running = start(command)
    said = running.communicate()[1].decode()
    assert running.returncode == 0, said


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Path:
    """A folder with the recordings `rig` and `rig2`."""
    folder = tmp_path_factory.mktemp("recorded")
    for seed, name in enumerate(("rig", "rig2")):
        finish(f"{RECORD} {folder / name} --seed {seed} --effects coulomb_friction:joint4:torque=1.2")
    return folder


@pytest.fixture
def place(recorded, tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    shutil.copytree(recorded, tmp_path, dirs_exist_ok=True)
    (tmp_path / "three.yaml").write_text(THREE)
    return tmp_path


def clear(place: Path) -> None:
    for path in [*place.glob("killed*"), *place.glob(".killed*")]:
        shutil.rmtree(path) if path.is_dir() else path.unlink()


def goes_on(command: str, more: str, place: Path) -> None:
    """The killed command completes, leaves nothing beside its result, and that is the whole one's."""
    finish(f"{command.replace('OUT', 'killed')} {more}")
    assert results(place / "killed") == results(place / "whole")
    assert not [*place.glob(".killed*"), *place.glob("killed?*")]


@pytest.mark.parametrize("name", QUICK)
def test_killed_at_a_write_a_command_goes_on(name, place):
    command, more = QUICK[name]
    finish(command.replace("OUT", "whole"))
    for number in WRITES[name]:
        clear(place)
        dying = start(command.replace("OUT", "killed"), "-c", DYING, str(number))
        assert dying.communicate() and dying.returncode == -signal.SIGKILL
        goes_on(command, more, place)


@pytest.mark.slow
@pytest.mark.timeout(1800)  # twenty runs of a command, each of which may take half a minute
@pytest.mark.parametrize("name", ALL)
def test_killed_at_ten_random_times_a_command_goes_on(name, place):
    command, more = ALL[name]
    began = time.monotonic()
    finish(command.replace("OUT", "whole"))
    whole, rng, killed, done = time.monotonic() - began, random.Random(name), 0, 0
    while killed < 10:
        clear(place)
        began = time.monotonic()
        running = start(command.replace("OUT", "killed"), start_new_session=True)
        with suppress(subprocess.TimeoutExpired):
            running.wait(whole * rng.random())
            whole = time.monotonic() - began  # it was quicker than before: other programs let it be
        running.kill()  # this process alone: its workers must end by themselves
        running.communicate()
        killed, done = killed + (running.returncode != 0), done + (running.returncode == 0)
        assert done < 20, "it is done whenever it should be killed"
        if running.returncode == 0 or _complete(place, command):
            assert results(place / "killed") == results(place / "whole")
        else:
            assert running.returncode == -signal.SIGKILL
            goes_on(command, more, place)


def _complete(place: Path, command: str) -> bool:
    """Whether a command was killed after its result had taken its name: then it would be refused, rightly."""
    new_folder = command.split()[0] in ("fit", "diagnose", "record", "render", "finetune")
    return (place / "killed").is_dir() if new_folder else any((place / "killed").glob("*.html"))


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_says_what_goes_on_and_ends_the_workers_at_once(tmp_path, monkeypatch, number):
    """Of a terminal, which reaches everybody, and of a batch system, which may reach the program alone."""
    monkeypatch.chdir(tmp_path)
    command = "render --world nominal --frames 4000 --size 32 --workers 2 --out frames"
    running = start(command, start_new_session=True)
    while not (tmp_path / "frames.unfinished" / "plan.json").exists():
        assert running.poll() is None
        time.sleep(0.1)
    time.sleep(3)
    os.killpg(running.pid, number) if number == signal.SIGINT else running.send_signal(number)
    said = running.communicate(timeout=20)[1].decode().strip().splitlines()
    assert running.returncode == 128 + number
    assert said[-1] == f"vispeg: interrupted; to continue: vispeg {command}"
    assert not [line for line in said if "Traceback" in line]
    assert _alone(running.pid), "workers are still there"


def _alone(group: int) -> bool:
    """Whether a group of processes has ended, within ten seconds."""
    for _ in range(100):
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.1)
    return False
