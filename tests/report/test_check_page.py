"""The page of `vispeg check` shows the faults that were put into a recording, where they were put, and nothing else."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made import recording
from pages import plain

from vispeg.api.recording.contact import check_contact
from vispeg.diagnosis.pictures.excited import Excitation
from vispeg.recordings.cell import WrenchSensor
from vispeg.recordings.checks.check import check
from vispeg.recordings.checks.excitation import PARAMETERS
from vispeg.recordings.checks.plot import plot
from vispeg.recordings.checks.quality import Limits
from vispeg.recordings.recording import Control
from vispeg.report.checked.examined import examined
from vispeg.report.checked.page import lines_of, render
from vispeg.report.checked.tables import _excited

from .test_traces import decoded

RATE, N, LOST, SPIKE, STUCK = 500.0, 5000, slice(2000, 2010), 700, slice(3300, 3340)
LIMITS = Limits(np.full((2, 2), [-3.0, 3.0]), np.full(2, 9.0), np.full(2, 100.0))


def faulty(name="rig"):
    """Two joints on sines with ten samples lost, one reading that jumps by 0.2 rad, one torque that clips for 80 ms."""
    rng = np.random.default_rng(3)
    time = np.arange(N) / RATE
    q = np.stack([0.8 * np.sin(np.pi * time), 0.4 * np.sin(1.9 * time) + 0.3 * np.sin(5 * time)], 1)
    tau = np.stack([20 * np.sin(time), 5 * np.cos(time)], 1) + rng.normal(scale=0.2, size=(N, 2))
    tau[STUCK, 1] = 9.0
    measured = q + rng.normal(scale=1e-5, size=q.shape)
    measured[SPIKE, 0] += 0.2
    rows = np.delete(np.arange(N), LOST)
    empty = dict.fromkeys(("dq", "tau_cmd", "ee", "ee_cmd", "ft"))
    arrays = {"time": time[rows], "q": measured[rows], "q_cmd": q[rows], "tau": tau[rows]}
    return recording(len(rows), RATE, path=Path(name), **(empty | arrays))


def made(rec, contact=None, cameras=()):
    found, touched = contact or (None, None)
    report = replace(check(rec, LIMITS), contact=found)
    return examined(rec, report, LIMITS, (cameras, ()), rec.cell is not None, touched, plot(rec, report, LIMITS))


def charts(html):
    """The data of each of the page's widgets."""
    return [json.loads(text) for text in re.findall(r"data-values>(.*?)</script>", html, re.S)]


@pytest.fixture(scope="module")
def page():
    return render([made(faulty()), made(faulty("again"))], [], "vispeg check rig again --out checked")


def test_gaps_bad_readings_and_saturation_are_drawn_where_they_are(page):
    (data,) = charts(page)
    assert [track["name"] for track in data["tracks"]] == ["rig", "again"]
    track = data["tracks"][0]
    time = np.array(track["time"])
    ((start, stop),) = track["bands"]
    assert (start, stop) == pytest.approx(((LOST.start - 1) / RATE, LOST.stop / RATE), abs=1e-4)
    bad = decoded(track["arrays"]["bad"])
    assert np.isnan(bad[1]).all(), "the other joint has none"
    dots = np.isfinite(bad[0])
    assert time[dots] == pytest.approx(SPIKE / RATE, abs=2e-2)
    truth = 0.8 * np.sin(np.pi * SPIKE / RATE) + 0.2
    assert bad[0][dots] == pytest.approx(truth, abs=1e-3)
    q = decoded(track["arrays"]["q"])[0]
    assert np.isnan(q[(time > start) & (time < stop)]).any(), "no line bridges the gap"
    near = np.abs(time - SPIKE / RATE) < 0.02
    assert np.nanmax(np.abs(q[near] - 0.8 * np.sin(np.pi * time[near]))) < 0.05, "no line goes to a bad reading"
    clipped = decoded(track["arrays"]["tau_clipped"])
    assert np.isnan(clipped[0]).all() and np.nanmax(np.abs(clipped[1] - 9.0)) < 1e-3
    inside = time[np.isfinite(clipped[1])]
    assert inside.min() >= STUCK.start / RATE - 0.02 and inside.max() <= STUCK.stop / RATE + 0.02


@pytest.mark.parametrize("n", [3000, N])
def test_no_line_leads_from_one_episode_to_the_next(n):
    rec = recording(n, RATE, episode=np.repeat([0, 1], n // 2))
    for signal in made(rec).signals.arrays.values():
        assert np.isnan(signal[len(signal) // 2 - 3 : len(signal) // 2 + 3]).any()


def test_the_page_says_what_the_terminal_says(page):
    one, page = made(faulty()), plain(page)
    for line in lines_of(one):
        assert line.replace("'", "&#39;") in page, line
    assert "samples lost" in page and "tau is saturated in" in page
    assert f"rig, again: {2 * len(lines_of(one))} warnings" in page


def test_the_shares_of_the_table_are_those_of_the_report(page):
    report = check(faulty(), LIMITS)
    cells = re.findall(r"<b>([\d.]+) %</b>", plain(page))
    each = [100 * share for joint in report.joints for share in joint.excitation.identifiability.values()]
    assert [float(c) for c in cells] == pytest.approx([*each, *each], rel=0.06)
    assert "not determined</span>" not in page


def test_a_share_of_nearly_all_has_no_exponent():
    moved = {"identifiability": dict.fromkeys(PARAMETERS, 0.997)}
    rec = faulty()
    report = check(rec, LIMITS)
    joint = replace(report.joints[0], excitation=replace(report.joints[0].excitation, **moved))
    shown = replace(made(rec), report=replace(report, joints=(joint,)))
    assert re.findall(r"<b>([^<]+) %</b>", plain(render([shown], [], "vispeg check rig")))[0] == "100"


def test_what_a_small_motion_confounds_is_not_determined():
    """There cos q is nearly 1, as a constant torque is; in the wide motion beside it both are told."""
    rec = faulty()
    noise = 1e-6 * np.random.default_rng(4).normal(size=len(rec.time))
    rec = replace(rec, q=np.stack([rec.q[:, 0], 0.04 * np.sin(2 * rec.time) + noise], 1))
    page = render([made(rec)], [], "vispeg check rig")
    first, second = re.findall(r'<tr><th scope="row">joint\d</th>(.*?)</tr>', page)
    assert "not determined" not in first
    told = [name for name, cell in zip(PARAMETERS, second.split("</td>"), strict=False) if "not determined" in cell]
    assert told == ["gravity_cos", "bias"]


def test_a_clean_recording_has_a_page_without_a_warning():
    time = np.arange(N) / RATE
    rec = faulty()
    q = np.stack([0.8 * np.sin(np.pi * time), 0.6 * np.sin(1.9 * time) + 0.4 * np.sin(5 * time)], 1)
    noise = np.random.default_rng(5).normal(size=(2, N, 2))
    tau = np.stack([20 * np.sin(time), 5 * np.cos(time)], 1) + 0.2 * noise[1]
    html = render([made(replace(rec, time=time, q=q + 1e-5 * noise[0], q_cmd=q, tau=tau))], [], "vispeg check rig")
    (data,) = charts(html)
    assert "rig: no warning" in html and "Nothing to warn of." in html
    assert not {"bad", "tau_clipped"} & set(data["tracks"][0]["arrays"]) and data["tracks"][0]["bands"] == []


def test_names_with_markup_are_text_and_nothing_leaves_the_page():
    rec = replace(faulty("<img src=x onerror=alert(1)>"), joints=("el<b>bow</b>", "</script><b>"), motion="<i>")
    html = render([made(rec)], [], "vispeg check '<b>'")
    assert not re.search(r"<b>bow|<img src=x|<i>|</script><b>", html)
    (data,) = charts(html)
    assert data["channels"] == ["el<b>bow</b>", "</script><b>"]
    assert not re.search(r"""(?:src|href)=["'](?!data:|#)""", html)
    assert "default-src 'none'" in html


def test_joints_that_differ_have_charts_of_their_own():
    other = replace(faulty("other"), joints=("joint3", "joint4"))
    data = charts(render([made(faulty()), made(other), made(faulty("again"))], [], "vispeg check"))
    assert [d["channels"] for d in data] == [["joint1", "joint2"], ["joint3", "joint4"]]
    assert [[t["name"] for t in d["tracks"]] for d in data] == [["rig", "again"], ["other"]]


def test_contact_is_shaded_where_the_sensor_feels_a_force():
    """A still arm whose wrench sensor feels 12 N along its axis for one second in the middle."""
    n = 2000
    time = np.arange(n) / RATE
    q = np.tile([0.0, 0.6, 0.0, -1.2, 0.0, 1.0, 0.0], (n, 1))
    ft = np.random.default_rng(1).normal(scale=0.02, size=(n, 6))
    felt = (time >= 2.0) & (time < 3.0)
    ft[felt, 2] -= 12.0
    empty = dict.fromkeys(("dq", "tau", "tau_cmd", "q_cmd", "ee", "ee_cmd"))
    rec = recording(n, RATE, joints=tuple(f"joint{i}" for i in range(1, 8)), **(empty | {"time": time, "q": q}))
    rec = replace(rec, ft=ft, wrench=WrenchSensor(), noise={"ft": 0.02, "ft_torque": 0.02})
    found = check_contact(rec)
    assert found is not None
    rec = replace(rec, control=Control("unknown", RATE))
    for some in (slice(None, None, -1), slice(6)):  # another order of the joints, and without the last, which rests
        other = check_contact(replace(rec, joints=rec.joints[some], q=rec.q[:, some]))
        assert other is not None
        np.testing.assert_allclose(other[1].flange, found[1].flange, atol=1e-9)
    limits = Limits(np.full((7, 2), [-3.0, 3.0]), np.full(7, 9.0), np.full(7, 100.0))
    report = replace(check(rec, limits), contact=found[0])
    html = render(
        [examined(rec, report, limits, ((), ()), True, found[1], plot(rec, report, limits))], [], "vispeg check rig"
    )
    track = charts(html)[1]["tracks"][0]
    ((start, stop),) = track["bands"]
    assert (start, stop) == pytest.approx((2.0, 3.0), abs=0.05)
    force = np.linalg.norm(decoded(track["arrays"]["contact"]), axis=0)
    middle = (np.array(track["time"]) > 2.2) & (np.array(track["time"]) < 2.8)
    assert np.median(force[middle]) == pytest.approx(12.0, abs=0.1)
    assert "over 100 N" in plain(html) and "in free air" in html


def test_what_pictures_do_not_show_is_said_with_the_motion_alone_or_by_parameter():
    whole = Excitation("exposure", "wrist", "light", 0.07, 0.25, ("gain",))
    part = Excitation("camera_offset", "wrist", "border", 3.0, 0.2, ("z",))
    rows = _excited([whole, part, replace(part, silent=())]).rows
    assert [row[-1] for row in rows] == ["a stated look", "z: look", ""]
