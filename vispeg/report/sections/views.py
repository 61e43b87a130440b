"""The section of a diagnosis of pictures: measured and rendered views, and shifts at working distances."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from vispeg.report.drawings.figures import AFTER, BEFORE, Shape, chart, new_figure, quiet
from vispeg.report.record import Record, data_link
from vispeg.report.text.camera_words import confounded

TITLE = "Pictures, measured and rendered"
VIEWS = 8  # most views that are shown
ENLARGED = 4.0  # factor by which displacements are drawn
PINK, TEAL = (216, 27, 96), (0, 150, 136)  # colours of edges before and after
LEAST = 0.5  # px, smallest displacement drawn as a line
UNUSUAL = 0.8  # deviation above which a sensor's figure is shown, as a share of the difference between good cameras
AWAY = 12.0  # mm, depth difference drawn in full red or blue


def context(record: Record) -> Mapping[str, object] | None:
    """Return rows of pictures, maps of the projections, confounded effects and sensor figures; None without views."""
    values = record.mapping("views")
    if not values:
        return None
    arrays = record.evidence.views
    return {
        "values": values,
        "rows": [row for k in range(VIEWS) if (row := _row(arrays, f"view/{k}/"))],
        "maps": _maps(values, arrays),
        "alike": confounded(values),
        "sensor": _sensor(values),
        "unusual": UNUSUAL,
        "channels": record.rows("channels"),
    }


def _sensor(values: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Return the kinds of pictures with unusual sensor figures, and those figures."""
    out = []
    for row in values.get("sensor") or []:
        figures = [f for f in row["figures"] if max(abs(f["before"]), abs(f["after"])) > UNUSUAL]
        if figures:
            out.append({"kind": row["kind"], "figures": figures})
    return out


def _row(arrays: Mapping[str, np.ndarray], name: str) -> Mapping[str, object] | None:
    """Return title, colour and depth pictures of the view whose arrays' keys begin with `name`; None without it."""
    if name + "measured" not in arrays:
        return None
    measured = arrays[name + "measured"]
    colours: list[Mapping[str, str]] = []
    depths: list[Mapping[str, str]] = []
    for word, said in (("measured", "measured"), ("before", "as believed"), ("after", "as found")):
        if name + word in arrays:
            colours.append({"src": _png(arrays[name + word]), "said": said})
    for word, colour, said in (("before", PINK, "off, as believed"), ("after", TEAL, "off, as found")):
        if name + f"along_{word}" in arrays:
            colours.append({"src": _png(_drawn(measured, arrays, name, word, colour)), "said": said})
    if name + "depth" in arrays:
        from vispeg.render.image_kinds import depth_picture

        depth = arrays[name + "depth"]
        for word, said in (("depth", "measured"), ("depth_before", "as believed"), ("depth_after", "as found")):
            if name + word in arrays:
                depths.append({"src": _png(depth_picture(arrays[name + word])), "said": said})
        for word, said in (("depth_before", "off, as believed"), ("depth_after", "off, as found")):
            if name + word in arrays:
                depths.append({"src": _png(_difference(depth, arrays[name + word])), "said": said})
    return {"title": str(arrays[name + "title"]), "colour": colours, "depth": depths}


def _drawn(
    measured: np.ndarray, arrays: Mapping[str, np.ndarray], name: str, word: str, colour: tuple[int, int, int]
) -> np.ndarray:
    """Draw on the pale measured image a line from each border point to its edge, `ENLARGED` times as long.

    Args:
        measured: (H, W, 3) uint8.
        arrays: with `pixel` (n, 2) px, `normal` (n, 2) and `along_{word}` (n,) px, the edge along the normal.
            A point within `LEAST` of its edge is drawn as a dot, and so is one without an edge (NaN).
        name: prefix of the arrays' keys, such as `view/0/`.
        word: the model, `before` or `after`.
        colour: of the lines.

    Returns:
        (k H, k W, 3) uint8, enlarged by a whole number k to about 640 px.
    """
    import cv2

    scale = max(1, round(640 / measured.shape[1]))
    grey = cv2.cvtColor(measured, cv2.COLOR_RGB2GRAY)
    pale = cv2.cvtColor((128 + grey // 2).astype(np.uint8), cv2.COLOR_GRAY2RGB)
    out = cv2.resize(pale, None, fx=scale, fy=scale, interpolation=cv2.INTER_LINEAR)
    along = np.nan_to_num(arrays[name + f"along_{word}"])
    for at, n, off in zip(arrays[name + "pixel"], arrays[name + "normal"], along, strict=True):
        start = tuple(int(round(v)) for v in scale * (at + 0.5) - 0.5)
        end = tuple(int(round(v)) for v in scale * (at + ENLARGED * off * n + 0.5) - 0.5)
        if abs(off) > LEAST:
            cv2.line(out, start, end, colour, 1, cv2.LINE_AA)
        else:
            cv2.circle(out, start, 1, colour, -1, cv2.LINE_AA)
    return out


def _difference(measured: np.ndarray, modelled: np.ndarray) -> np.ndarray:
    """Draw the difference of two depths (H, W) m: red if measured is farther, blue if nearer, yellow if one is missing.

    Returns (H, W, 3) uint8.
    """
    both = (measured > 0) & (modelled > 0)
    share = np.clip(1000 * np.where(both, measured - modelled, 0) / AWAY, -1, 1)
    out = np.full((*measured.shape, 3), 245, np.float32)
    out[..., 1:] -= (np.maximum(share, 0) * 200)[..., None]
    out[..., :2] -= (np.maximum(-share, 0) * 200)[..., None]
    out[(measured > 0) != (modelled > 0)] = (240, 200, 60)
    return np.clip(out, 0, 255).astype(np.uint8)


def _maps(values: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> list[Mapping[str, Any]]:
    """Return for each camera and distance the row of the record, and as `svg` how the found effects shift its image."""
    out = []
    for k, row in enumerate(values.get("projection") or []):
        if f"projection/{k}/shift" not in arrays or not (row["rms_px"] or row["uncertainty_px"]):
            continue  # nothing of this camera was fitted, so it has neither a shift nor an uncertainty
        pixels, shift = (arrays[f"projection/{k}/{key}"] for key in ("pixels", "shift"))
        title = f"{row['camera']} at {row['distance_m']:g} m: {row['rms_px']:.2f} px RMS"

        def draw(shape: Shape, pixels=pixels, shift=shift, title=title):
            figure = new_figure(3.2, shape.width / 2 if not shape.narrow else shape.width)
            ax = figure.subplots()
            ax.quiver(
                pixels[..., 0], pixels[..., 1], shift[..., 0], shift[..., 1],
                angles="xy", scale_units="xy", scale=0.5, color=BEFORE, width=0.004,
            )  # fmt: skip
            ax.plot(pixels[..., 0].ravel(), pixels[..., 1].ravel(), ".", color=AFTER, ms=2)
            ax.invert_yaxis()
            ax.set_aspect("equal")
            ax.set_xlabel("px; arrows are drawn twice as long")
            quiet(ax)
            return figure

        out.append({**row, "svg": chart(draw, f"projection{k}", title) if row["rms_px"] > 0 else ""})
    return out


def _png(image: np.ndarray) -> str:
    """Return an RGB image (H, W, 3) uint8 as a data link."""
    import cv2

    return data_link(cv2.imencode(".png", np.ascontiguousarray(image[..., ::-1]))[1].tobytes())
