"""Figures keep what matters of the data and stay inside the page."""

import re
from io import StringIO
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib import rc_context

from vispeg.core.errors import UserError
from vispeg.core.lines import thin
from vispeg.core.seeds import stream
from vispeg.report.drawings.camera_residuals import residual_figure
from vispeg.report.drawings.figures import WIDE, legend, new_figure, saved, styled, svg
from vispeg.report.drawings.signature import signature_panels
from vispeg.report.drawings.strips import interval_strip, place
from vispeg.report.evidence import ResidualMap
from vispeg.report.sections.maps import maps_picture, scale_levels


def test_thinning_keeps_extremes_order_and_gaps():
    time = np.arange(20_000) / 500
    values = stream(0, "thin").standard_normal(time.size)
    values[7_003], values[12_345], values[15_000:16_000] = 40.0, -50.0, np.nan
    given = values.copy()
    t, v = thin(time, values, 1500)
    assert len(t) <= 1500 and np.all(np.diff(t) > 0)
    assert np.nanmax(v) == 40.0 and np.nanmin(v) == -50.0
    assert np.isnan(v[(t > 30.1) & (t < 31.9)]).all() and np.isnan(v).any()
    np.testing.assert_array_equal(values, given)
    index = np.searchsorted(time, t)
    np.testing.assert_array_equal(values[index], v)


@pytest.mark.parametrize("n", [900, 20_000])
@pytest.mark.parametrize("every", [1, 7])
def test_a_gap_of_one_sample_stays_and_a_slower_line_has_none(n, every):
    time = np.arange(n) / 500
    values = np.where(np.arange(n) % every == 0, np.sin(time), np.nan)
    assert np.isfinite(thin(time, values)[1]).all()
    gone = n // 3 // every * every
    values[gone] = np.nan
    t, v = thin(time, values)
    (at,) = t[np.isnan(v)]
    assert abs(at - time[gone]) < every / 500 and len(t) <= 1500


def test_short_lines_are_left_alone():
    t, v = thin(np.arange(5.0), np.arange(5.0))
    assert len(t) == len(v) == 5


@pytest.mark.parametrize(
    "label",
    [
        'id="a"',
        'd="M 1.23456"',
        'style="fill: #16181d"',
        "joint font-family: 1; 2",
        "url(#a",
        "a version='2'",
        'x="1.234"',
    ],
)
def test_a_name_is_shown_as_it_is_even_if_it_looks_like_markup(label):
    with styled():
        figure = new_figure(2.0)
        figure.subplots().set_title(label)
        text = svg(figure, "names", "names")
    (shown,) = [e.text for e in ElementTree.fromstring(text).iter("text") if not re.fullmatch(r"[\d.]+", e.text)]
    assert shown == label


def test_a_figure_that_is_laid_out_first_is_drawn_as_savefig_draws_it():
    """Slow oracle: matplotlib's own layout, which draws all twice, and titles placed by a search for ticks above."""

    def drawn(by, **style):
        with styled(), rc_context(style):
            figure = new_figure(3.0)
            for ax, size in zip(figure.subplots(2, 2, sharex=True).ravel(), (1.0, 1e-4, 1e3, 30.0), strict=True):
                ax.plot([0, 1, 2], [0, size, -size])
                ax.set_title("residual (mrad)")
                ax.set_title("RMS 1.2", loc="right")
            legend(figure, {"measured": ("#000000", "-"), "model": ("#ff0000", "-")})
            return by(figure, "panels", "four panels")

    assert drawn(svg) == drawn(saved, **{"axes.titley": None})


def test_svg_text_is_text_and_ids_are_its_own():
    with styled():
        figure = new_figure(2.0)
        ax = figure.add_subplot()
        ax.plot([0, 1], [0, 1])
        ax.set_title("a $b$ <c> & d")
        text = svg(figure, "mine", 'say "x" <y>')
    assert "a $b$ &lt;c&gt; &amp; d" in text
    assert "http" not in text and "<metadata" not in text and 'aria-label="say &quot;x&quot; &lt;y&gt;"' in text
    ids = re.findall(r'\bid="([^"]*)"', text)
    used = re.findall(r"url\(#([^)]*)\)", text) + re.findall(r'href="#([^"]*)"', text)
    assert len(ids) == len(set(ids)) and all(i.startswith("mine-") for i in ids)
    assert used and set(used) <= set(ids)


def test_a_curve_in_fewer_letters_is_the_same_to_a_twentieth_of_a_pixel():
    with styled():
        figure = new_figure(2.0)
        time = np.linspace(0, 1, 400)
        figure.add_subplot().plot(time, np.sin(60 * time) * np.exp(-time))
        raw = StringIO()
        figure.savefig(raw, format="svg", transparent=True)
        text = svg(figure, "mine", "a curve")
    full, short = (
        max((re.findall(r"-?[\d.]+", d) for d in re.findall(r'\bd="([^"]*)"', t)), key=len)
        for t in (raw.getvalue(), text)
    )
    assert len(full) == len(short) > 200
    assert np.abs(np.array(full, float) - np.array(short, float)).max() <= 0.0501
    assert len(text) < 0.6 * len(raw.getvalue())


@pytest.mark.parametrize("top", [3.0, 3.01, 7.0, 40.0, 1e4])
def test_colour_steps_cover_the_data(top):
    levels = scale_levels(top)
    assert levels[0] == 1.0 and levels[-2] < top <= levels[-1] and np.all(np.diff(levels) > 0)


def test_a_strip_places_values_between_the_bounds():
    assert place(2.5, 0, 10) == 0.25 and place(-1, 0, 10) == 0.0 and place(11, 0, 10) == 1.0
    assert place(1.0, 0.01, 100, "log") == pytest.approx(0.5)
    assert "circle" in interval_strip(1.0, (None, None), (0, 2)) and interval_strip(None, (0, 1), (0, 2)) == ""


@pytest.mark.parametrize("kind", ["png", "svg"])
def test_signature_panels(tmp_path, kind):
    time = np.linspace(0, 2, 400)
    path = tmp_path / f"x.{kind}"
    lines = {"nominal": np.sin(time), "coulomb_friction": np.sin(time) + 0.1 * np.sign(np.cos(time))}
    assert signature_panels("coulomb_friction(joint4)", time, [("rad", lines)], path) == path
    assert path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n" if kind == "png" else b"coulomb_friction" in path.read_bytes()
    with pytest.raises(UserError, match="exists"):
        signature_panels("again", time, [("rad", lines)], path)
    with pytest.raises(UserError, match="differ"):
        signature_panels("short", time[:-1], [("rad", lines)], tmp_path / "y.png")
    with pytest.raises(UserError, match="kind of file"):
        signature_panels("odd", time, [("rad", lines)], tmp_path / "y.bmp")


def test_frames_of_two_episodes_are_two_lines_over_time():
    """Each starts at 0 s, and one line through both would run back and forth between them."""
    frames = [
        {"recording": r, "episode": e, "time": t, "border_px": e + 1.0}
        for r, e in (("a", 0), ("a", 1), ("b", 0))
        for t in (0.0, 1.0, 2.0)
    ]
    over_time = residual_figure({}, frames, WIDE).axes[2].get_lines()
    assert len(over_time) == 3
    for line in over_time:
        assert list(line.get_xdata()) == [0.0, 1.0, 2.0] and len(set(line.get_ydata())) == 1


def test_the_middle_of_a_measured_range_is_zero_on_the_axis_of_a_map():
    """Of -1.8337 to 1.8333 rad the middle was written as -0.00019."""
    cells = np.full((1, 12), 2.0)
    drawn = maps_picture([ResidualMap("position", np.linspace(-1.8337, 1.8333, 13), cells, cells)], ("joint1",))
    assert ">0<" in drawn and "−0.92" in drawn and "0.000" not in drawn
