"""Units that cannot be true, in the same words by every command; and no alarm where all of them are right."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vispeg.recordings.checks.quality import Limits
from vispeg.recordings.importers.plausible import doubts
from vispeg.recordings.load import load
from vispeg.recordings.recording import Control, Recording
from vispeg.recordings.write import write

DEGREES = 180 / np.pi
REFUSED = {  # signals and their factors -> what is said
    "torques in millinewton metres": ({"tau": 1e3}, "tau.*", "times what the model needs", "mNm or N mm"),
    "speeds in degrees": ({"dq": DEGREES}, "dq.joint1 ... dq.joint7", "57.3 times the change", "deg/s for dq"),
    "speeds in rpm": ({"dq": 60 / (2 * np.pi)}, "dq.joint1 ... dq.joint7", "9.55 times the change", "rpm"),
    "one speed the other way": ({"dq": np.eye(7)[2] * -2 + 1}, "dq.joint3:", "-1 times", "the other sign"),
    "angles in degrees": ({"q": DEGREES / 2, "q_cmd": 0.5, "dq": None}, "q, q_cmd", "times the commanded", "deg"),
    "all angles in degrees": (
        {"q": DEGREES / 2, "q_cmd": DEGREES / 2, "dq": DEGREES / 2},
        "q.joint",
        "outside the joints' ranges",
        "deg",
    ),
}
WARNED = {
    "torques in kilonewton metres": ({"tau": 1e-3}, "tau.*", "times what the model needs", "kNm"),
    "one speed at another scale": ({"dq": np.eye(7)[1] * 1.3 + 1}, "dq.joint2:", "2.3 times", "the sensor's scale"),
}


def scaled(source, folder, factors):
    """A copy with signals times factors, without those whose factor is None; angles about their middle.

    Angles that are large in degrees are refused as they are read.
    """
    rec = load(source)
    middle = dict.fromkeys(("q", "q_cmd"), rec.q.mean(axis=0) if "q" in factors else 0.0)
    signals = {k: None if f is None else f * (getattr(rec, k) - middle.get(k, 0.0)) for k, f in factors.items()}
    return write(replace(rec, **signals), folder)


def together(text):
    return " ".join(text.split())


@pytest.mark.parametrize("case", REFUSED)
def test_two_signals_that_exclude_each_other_are_refused(vispeg, rigs, tmp_path, case):
    factors, *words = REFUSED[case]
    bad = scaled(rigs["friction"], tmp_path / "bad", factors)
    lines = []
    for command in (
        ["compare", "iiwa14", "--recording", bad],
        ["diagnose", "iiwa14", "--recording", rigs["friction2"], "--validate", bad],
        ["measure", "joint", bad],
    ):
        code, _, err = vispeg(*command, "--out", tmp_path / "out")
        assert code == 2 and err.count("error") == 1 and not (tmp_path / "out").exists()
        lines.append(together(err.partition("error: ")[2]))
    assert len(set(lines)) == 1 and all(word in lines[0] for word in (str(bad), *words)), lines
    code, out, _ = vispeg("check", bad)
    assert code == 0 and all(word in together(out) for word in words)


@pytest.mark.parametrize("case", WARNED)
def test_what_only_a_model_or_one_sensor_speaks_against_is_said(vispeg, rigs, tmp_path, case):
    factors, *words = WARNED[case]
    bad = scaled(rigs["friction"], tmp_path / "bad", factors)
    code, _, err = vispeg("compare", "iiwa14", "--recording", bad, "--out", tmp_path / "out")
    assert code == 0 and all(word in together(err) for word in words), err
    code, out, _ = vispeg("check", bad)
    assert code == 0 and all(word in together(out) for word in words)


def test_right_units_draw_no_line(vispeg, rigs, tmp_path):
    for name, source in rigs.items():
        code, out, err = vispeg("check", source)
        assert code == 0 and "is wrong" not in out, (name, err)
    code, _, err = vispeg("compare", "iiwa14", "--recording", rigs["nominal"], "--out", tmp_path / "out")
    assert code == 0 and "is wrong" not in err


def test_a_limit_that_is_none_makes_no_unit_wrong():
    """A robot file that states 0.1 N m for every joint: torques that move the arm are N m all the same."""
    q = np.linspace(-1, 1, 400)[:, None]
    time, weigh = np.arange(400) / 100.0, lambda angle, *rates: 20.0 * np.cos(angle)
    rec = Recording(Path("arm"), "arm", ("a",), 100.0, Control(), time, q, tau=weigh(q), torque_sensor="joint")
    limits = Limits(np.array([[-3.0, 3.0]]), np.array([3.0]), np.array([0.1]))
    assert [d.key for d in doubts(rec, limits)] == ["tau.a"]
    assert doubts(rec, limits, needs=weigh) == []
    (doubt,) = doubts(replace(rec, tau=1e3 * weigh(q)), limits, needs=weigh)
    assert doubt.sure and "mNm" in doubt.likely


def driven(speeds):
    """A recording at 100 Hz of seven joints that swing, and its measured speeds times `speeds`; one without stands."""
    time = np.arange(400)[:, None] / 100
    moves = np.array([factor is not None for factor in speeds])
    phase = time * np.linspace(1.0, 3.0, 7)
    dq = moves * np.cos(phase) * np.linspace(1.0, 3.0, 7) * [factor or 0.0 for factor in speeds]
    joints = tuple(f"joint{j + 1}" for j in range(7))
    return Recording(Path("r"), "iiwa14", joints, 100.0, Control(), time[:, 0], moves * np.sin(phase), dq)


@pytest.mark.parametrize(
    ("speeds", "said"),
    [
        ([2.5] * 7, ["dq.joint1 ... dq.joint7", "are 2.5 times", "likely 250 samples a second"]),
        ([2.5] * 5 + [None] * 2, ["dq.joint4, dq.joint5:", "are 2.5 times", "likely 250 samples a second"]),
        ([2.5] * 5 + [1.0, None], ["dq.joint4, dq.joint5:", "are 2.5 times", "the sensor's scale"]),
        ([2.5, *[None] * 6], ["dq.joint1:", "are 2.5 times", "the sensor's scale"]),
        ([2.5, 5.0, *[4.0] * 5], ["dq.joint1 ... dq.joint7", "are 2.5 to 5 times", "the sensor's scale"]),
    ],
    ids=["all move", "two stand", "one is right", "one moves", "of different gears"],
)
def test_a_factor_of_the_time_is_that_of_every_joint_that_moves(speeds, said):
    unknown = np.full(7, np.inf)
    line = doubts(driven(speeds), Limits(np.stack([-unknown, unknown], 1), unknown, unknown))[0].line
    assert all(word in line for word in said), line
