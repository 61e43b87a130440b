"""What the page's charts are given: every peak, every gap, small numbers beside large ones, and names as text."""

import base64
import json
import re
from dataclasses import replace

import numpy as np
import pytest

from vispeg.core.errors import UserError
from vispeg.core.lines import thinned, thinned_time
from vispeg.core.seeds import stream
from vispeg.diagnosis.traces import Trace
from vispeg.diagnosis.traces import arrays as kept
from vispeg.report.evidence import evidence_of
from vispeg.report.live.arm import arm_arrays, stage
from vispeg.report.live.traces import Line, Panel, Track, coded, widget
from vispeg.report.record import Record
from vispeg.report.sections import wrench
from vispeg.report.sections.measured_vs_model import interactive
from vispeg.worlds.world import World


def decoded(row):
    codes = np.frombuffer(base64.b64decode(row["codes"]), "<i2").reshape(len(row["scale"]), -1)
    return np.where(codes == -32768, np.nan, codes * np.array(row["scale"])[:, None])


def test_codes_are_exact_to_a_65_thousandth_of_each_row_and_keep_gaps():
    rng = stream(0, "codes")
    values = rng.standard_normal((3, 500)) * np.array([[1.0], [1e-5], [0.0]])
    values[1, 40:50] = np.nan
    values[0, 7] = np.inf
    back = decoded(coded(values))
    assert np.array_equal(np.isnan(back), ~np.isfinite(values))
    size = np.nanmax(np.abs(np.where(np.isfinite(values), values, np.nan)), axis=1, keepdims=True)
    assert np.nanmax(np.abs(back - values)[:, 50:] / np.maximum(size, 1e-12)) <= 0.51 / 32767


@pytest.mark.parametrize("n", [10, 999, 4001])
def test_thinned_rows_keep_each_channels_extremes_and_the_clock(n):
    values = stream(1, "thin", str(n)).standard_normal((n, 4))
    time = np.arange(n) / 500.0
    rows, clock = thinned(values, 300), thinned_time(time, 300)
    assert len(rows) == len(clock) <= 300 and np.all(np.diff(clock) > 0)
    assert np.array_equal(rows.max(axis=0), values.max(axis=0))
    assert np.array_equal(rows.min(axis=0), values.min(axis=0))
    assert abs(clock[0] - time[0]) < 0.1 and abs(clock[-1] - time[-1]) < 0.1


def test_a_contact_in_the_last_samples_of_a_long_recording_is_drawn():
    time, force = np.arange(100_000) / 1000.0, np.zeros((100_000, 1))
    force[-100:] = 5.0
    rows, clock = thinned(force, 300), thinned_time(time, 300)
    assert rows.max() == 5.0 and rows[clock < 99.0].max() == 0.0
    assert time[-1] - clock[-1] < 0.5


@pytest.mark.parametrize("every", [1, 7])
def test_a_gap_shorter_than_an_interval_stays_and_a_slower_line_has_none(every):
    rows, time = np.arange(100_000), np.arange(100_000) / 1000.0
    values = np.where(rows % every == 0, np.sin(time), np.nan)[:, None]
    assert np.isfinite(thinned(values, 300)).all()
    values[40_005:40_030] = np.nan
    kept, clock = thinned(values, 300), thinned_time(time, 300)
    (at,) = clock[np.isnan(kept[:, 0])]
    assert at == pytest.approx(40.02, abs=1.0)


def test_a_line_without_its_array_is_not_offered_and_markup_in_names_stays_text():
    name = "</script><b>joint</b>"
    panels = (
        Panel(
            "motion", "rad", (Line("measured", "measured", "ink"), Line("after", "after", "after", minus="measured"))
        ),
        Panel("torque", "N m", (Line("torque", "tau", "ink"),)),
    )
    track = Track(name, np.arange(5.0), {"measured": np.ones((5, 1))})
    found = widget([name], panels, [track], [True])
    assert found["panels"] == [("motion", True)] and found["lines"] == [("measured", "ink")]
    assert "</script" not in found["data"] and json.loads(found["data"])["channels"] == [name]


def test_two_episodes_of_one_name_keep_their_own_torques():
    """Both are called `rig`, as episodes of one recording and recordings in two folders are; one is shorter."""
    made = [
        Trace("rig", unit, np.arange(n) / 100, values, 0 * values, None, channel=channel, beside=channel == "torque")
        for n, torque in ((800, 10.0), (600, 20.0))
        for channel, unit, values in (
            ("angle", "rad", np.full((n, 2), torque / 100)),
            ("torque", "N m", np.full((n, 2), torque)),
        )
    ]
    evidence = evidence_of(kept(made, ["a", "b"]))
    drawn = interactive(Record("compare", {}, evidence))
    assert len(set(drawn["tracks"])) == 2
    for track in json.loads(drawn["data"])["tracks"]:
        angle, torque = (decoded(track["arrays"][key]) for key in ("measured", "measured_tau"))
        assert angle.shape == torque.shape == (2, len(track["time"]))
        assert torque == pytest.approx(100 * angle, rel=1e-4)


def test_torques_follow_the_recording_that_they_belong_to():
    """The first of three recordings has no torque."""
    time = np.arange(8) / 100
    made = [
        Trace(name, unit, time, np.full((8, 2), value), np.zeros((8, 2)), None, channel=channel, beside=unit == "N m")
        for name, channel, unit, value in (
            ("free", "angle", "rad", 1.0),
            ("second", "angle", "rad", 2.0),
            ("second", "torque", "N m", 20.0),
            ("third", "angle", "rad", 3.0),
            ("third", "torque", "N m", 30.0),
        )
    ]
    evidence = evidence_of(kept(made, ["a", "b"]))
    every = [(t.name, t.measured[0, 0]) for t in evidence.every]
    assert every == [("free", 1), ("second", 2), ("second", 20), ("third", 3), ("third", 30)]
    drawn = wrench.context(Record("diagnosis", {"evidence": "contact"}, evidence_of(kept(of_axes(made), [*"xyz"]))))
    assert [picture["title"] for picture in drawn["pictures"]] == ["second", "third"] and drawn["hidden"] == 1


def of_axes(made):
    """The same traces with three columns and of forces, as those of a wrench are."""
    return [replace(t, measured=np.ones((8, 3)), before=np.zeros((8, 3))) for t in made]


@pytest.mark.parametrize("image", [np.zeros((4, 4, 3)), np.zeros((4, 4), np.uint8)])
def test_what_is_no_picture_is_said_with_its_shape_and_type(image):
    with pytest.raises(
        UserError, match=rf"expected \(H, W, 3\) uint8; got '{re.escape(str(image.shape))} {image.dtype}'"
    ):
        evidence_of({"picture/0/measured": image})


def test_the_pages_arm_has_the_models_shapes_where_the_model_has_them():
    import mujoco

    from vispeg.robots.model import load
    from vispeg.sim.compiled import compiled

    joints = [f"joint{i}" for i in range(1, 8)]
    arrays = {k.removeprefix("arm/"): v for k, v in arm_arrays(World(), joints).items()}
    model = compiled(load("iiwa14"))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for g in range(model.ngeom):
        m = model.geom_dataid[g]
        at = model.mesh_vertadr[m]
        vertices = model.mesh_vert[at : at + model.mesh_vertnum[m]] @ data.geom_xmat[g].reshape(3, 3).T
        low = np.minimum(low, (vertices + data.geom_xpos[g]).min(axis=0))
        high = np.maximum(high, (vertices + data.geom_xpos[g]).max(axis=0))
    turns = data.xmat.reshape(-1, 3, 3)[arrays["body"]]
    placed = np.einsum("nij,nj->ni", turns, arrays["vertex"]) + data.xpos[arrays["body"]]
    assert np.allclose(placed.min(axis=0), low, atol=1e-6) and np.allclose(placed.max(axis=0), high, atol=1e-6)
    shown = stage(arrays)
    assert sum(count for _, _, count in shown["parts"]) == len(arrays["face"])
    assert len(json.dumps(shown)) < 400_000


def test_a_fine_mesh_is_simplified_and_keeps_its_size():
    from trimesh.creation import icosphere

    from vispeg.report.live.shapes import simplified

    ball = icosphere(subdivisions=5, radius=0.3)
    vertices, faces = simplified(np.asarray(ball.vertices), np.asarray(ball.faces), 1500)
    assert 300 < len(faces) <= 1500 and faces.max() == len(vertices) - 1
    assert np.allclose(np.linalg.norm(vertices, axis=1), 0.3, rtol=0.05)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    volume = np.einsum("ni,ni->", a, np.cross(b, c)) / 6
    assert volume == pytest.approx(4 / 3 * np.pi * 0.3**3, rel=0.06), "faces still turn outwards"
