"""The page of a diagnosis of pictures: the worst frames side by side, and the projection's shift as a map."""

from __future__ import annotations

import numpy as np
from pages import plain

from vispeg.report.build import render
from vispeg.report.evidence import Evidence
from vispeg.report.record import Record
from vispeg.report.sections import VIEWS
from vispeg.report.sections.views import _difference, _drawn, context

SILENT = [  # of a record today, of one number alone, and of a record from before reasons were given
    {
        "effect": "camera_delay",
        "where": "wrist",
        "why": "a typical one moves these borders by 0.05 px",
        "motion": "look-fast",
    },
    {"effect": "motion_blur", "where": "wrist", "numbers": ["length"], "why": "no figure", "motion": "look-fast"},
    {"effect": "exposure", "where": "wrist"},
]
ROW = {"camera": "wrist", "distance_m": 0.25, "rms_px": 2.0, "largest_px": 3.0, "uncertainty_px": 0.1}
ALIKE = {"effect": "focal_error(wrist)", "rival": "camera_offset(wrist)", "views_px": 0.031, "projection": [ROW]}
ALIKE |= {"motion": "tilts of 20 degrees"}


def record() -> Record:
    image, depth = np.full((24, 32, 3), 90, np.uint8), np.full((24, 32), 0.3, np.float32)
    arrays = {f"view/0/{key}": image for key in ("measured", "before", "after")}
    arrays |= {f"view/0/{key}": depth for key in ("depth", "depth_before", "depth_after")}
    arrays |= {"view/0/title": np.array("look-b, wrist, 3.00 s"), "view/0/pixel": np.full((4, 2), 10.0)}
    arrays |= {"view/0/normal": np.tile([1.0, 0.0], (4, 1)), "view/0/along_before": np.full(4, 3.0)}
    arrays |= {"view/0/along_after": np.zeros(4), "projection/0/pixels": np.zeros((3, 4, 2))}
    arrays |= {"projection/0/shift": np.ones((3, 4, 2)), "projection/0/sigma": np.ones((3, 4))}
    views = {"projection": [ROW], "halves": {"px": 0.1, "uncertainty_px": 0.2}, "remainder": [], "not_excited": SILENT}
    views |= {"confounded": [ALIKE]}
    return Record("diagnosis", {"verdict": "identified", "views": views}, Evidence(views=arrays))


def test_the_page_shows_frames_depth_and_the_projection():
    values = context(record())
    assert values is not None
    assert [p["said"] for p in values["rows"][0]["colour"]] == [
        "measured", "as believed", "as found", "off, as believed", "off, as found",
    ]  # fmt: skip
    assert len(values["rows"][0]["depth"]) == 5 and values["maps"][0]["svg"].startswith("<svg")
    text = plain(render(record()))
    for said in ("camera_delay(wrist): a typical one", "motion_blur(wrist), length: no figure", "exposure(wrist)."):
        assert said in text
    alike = (
        "focal_error(wrist) and camera_offset(wrist): 0.03 px apart in these views; over the image 2.00 px at 0.25 m"
    )
    assert f"{alike}. To tell them: tilts of 20 degrees." in text
    assert "2.00 px" in text and "look-b, wrist, 3.00 s" in text and "views" in VIEWS
    assert context(Record("diagnosis", {"verdict": "identified"}, Evidence())) is None


def test_lines_end_beyond_their_border_on_the_side_of_the_edge():
    """The edge lies 10 px along the normal, and lines are drawn four times as long."""
    image = np.full((24, 640, 3), 90, np.uint8)
    arrays = {
        "v/pixel": np.array([[300.0, 12.0]]),
        "v/normal": np.array([[1.0, 0.0]]),
        "v/along_before": np.array([10.0]),
    }
    drawn = _drawn(image, arrays, "v/", "before", (216, 27, 96))
    (columns,) = np.nonzero(np.ptp(drawn[12], axis=1) > 20)  # the picture is grey
    assert (columns.min(), columns.max()) == (300, 340)


def test_a_projection_of_which_nothing_was_fitted_is_not_shown():
    """Its shift is none and its uncertainty is none, which says that it is known exactly."""
    still = record()
    views = {**still.values["views"], "projection": [{**ROW, "rms_px": 0.0, "largest_px": 0.0, "uncertainty_px": 0.0}]}
    values = context(Record("diagnosis", {**still.values, "views": views}, still.evidence))
    assert values is not None and values["maps"] == []


def test_depth_differences_have_a_colour_a_sign():
    measured = np.array([[0.3, 0.31, 0.29, 0.0]], np.float32)
    far, near, hole = _difference(measured, np.full((1, 4), 0.3, np.float32))[0, 1:]
    assert far[0] > far[1] and near[2] > near[0] and tuple(hole) == (240, 200, 60)
