"""The page of examined recordings: warnings, signals, and what the motion can identify."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from vispeg.core.counts import count
from vispeg.recordings.checks.check_words import FLAT
from vispeg.recordings.checks.contact_check import FORCES, WORDS, ContactCheck, said, together
from vispeg.recordings.checks.excitation import PARAMETERS, UNITS
from vispeg.recordings.checks.joint_check import JointCheck
from vispeg.report.checked import tables
from vispeg.report.checked.examined import Examined
from vispeg.report.live.traces import SCRIPTS, STYLES, Line, Panel, widget
from vispeg.report.page import Section, page
from vispeg.report.text.quantities import plain
from vispeg.vision.check import warnings_of

PARAMETER_WORDS = dict(
    zip(
        PARAMETERS,
        ("dry friction", "viscous friction", "inertia", "gravity, sine", "gravity, cosine", "constant torque"),
        strict=True,
    )
)
SIGNALS = (
    Panel(
        "angle",
        "rad",
        (
            Line("measured", "q", "ink", width=1.6),
            Line("commanded", "q_cmd", "before", dash=True),
            Line("bad reading", "bad", "red", dots=True),
        ),
    ),
    Panel("off its command", "rad", (Line("commanded − measured", "off", "before"),), visible=False),
    Panel("speed", "rad/s", (Line("speed", "speed", "after"),), visible=False),
    Panel(
        "torque",
        "N m",
        (
            Line("measured", "tau", "ink"),
            Line("commanded", "tau_cmd", "before", dash=True),
            Line("saturated", "tau_clipped", "red", dots=True),
            Line("command saturated", "tau_cmd_clipped", "wine", dots=True),
        ),
    ),
)
WRENCH = (
    Panel("contact force", "N", (Line("on the tool, base axes", "contact", "ink"),)),
    Panel("force as read", "N", (Line("flange on tool, flange axes", "force", "after"),), visible=False),
    Panel("torque as read", "N m", (Line("flange on tool, flange axes", "torque", "after"),), visible=False),
)


def render(checked: Sequence[Examined], repeats: Sequence[Mapping[str, object]], command: str) -> str:
    """Return the page as HTML.

    Args:
        checked: one or more examined recordings.
        repeats: groups of recordings that repeat one motion: {recordings, noise_q}, as in check.json.
        command: the command line that makes the page.
    """
    sections = [
        Section("headline", "", "check/headline", _headline(checked)),
        Section("signals", "What was recorded", "check/signals", _signals(checked), SCRIPTS, STYLES),
        Section("excites", "What the motion can identify", "check/excites", _excites(checked)),
    ]
    if any(rec.report.contact is not None for rec in checked):
        section = Section("contact", "Contact", "check/contact", _contact(checked), SCRIPTS, STYLES)
        sections.append(section)
    if any(rec.cameras for rec in checked):
        sections.append(Section("cameras", "Cameras", "check/cameras", _cameras(checked)))
    sections.append(Section("origin", "Origin", "check/origin", _origin(checked, repeats, command)))
    return page("vispeg check: " + ", ".join(rec.name for rec in checked), "check", sections)


def lines_of(rec: Examined) -> list[str]:
    """Return all warnings on a recording, one sentence each."""
    unstated = "state `cell:` in recording.yaml, so that these frames can show errors of their cameras"
    from_cameras = [line for camera in rec.cameras for line in warnings_of(camera)]
    return [
        *rec.report.warnings,
        *from_cameras,
        *([unstated] if rec.cameras and not rec.stated else ()),
    ]


def _headline(checked: Sequence[Examined]) -> Mapping[str, object]:
    counts = [len(lines_of(rec)) for rec in checked]
    names = ", ".join(rec.name for rec in checked) if len(checked) < 4 else f"{len(checked)} recordings"
    total = sum(counts)
    title = f"{names}: {count(total, 'warning')}" if total else f"{names}: no warning"
    clocks = [rec.report.timing for rec in checked]
    lost = sum(gap.samples for clock in clocks for gap in clock.gaps)
    bad = sum(len(joint.spikes) for rec in checked for joint in rec.report.joints)
    clipped = sum(n for rec in checked for joint in rec.report.joints for n in joint.saturated.values())
    figures = [
        ("recorded", f"{sum(clock.duration_s for clock in clocks):.1f} s", ""),
        ("samples lost in gaps", str(lost), ""),
        ("bad readings", str(bad), ""),
        ("saturated readings", str(clipped), ""),
    ]
    return {
        "title": title,
        "figures": figures,
        "recordings": [
            {"name": rec.name, "clock": tables.clock(rec.report), "lines": lines_of(rec)} for rec in checked
        ],
    }  # fmt: skip


def _signals(checked: Sequence[Examined]) -> Mapping[str, object]:
    """Return one chart per group of recordings with the same joints, and two tables per recording."""
    groups: dict[tuple[str, ...], list[Examined]] = {}
    for rec in checked:
        groups.setdefault(tuple(joint.name for joint in rec.report.joints), []).append(rec)
    return {
        "plots": [
            widget(joints, SIGNALS, [rec.signals for rec in group], [True] * len(joints))
            for joints, group in groups.items()
        ],
        "recordings": [
            {"name": rec.name, "paper": rec.paper, "sheets": [tables.motion(rec.report), tables.signals(rec.report)]}
            for rec in checked
        ],
    }  # fmt: skip


def _excites(checked: Sequence[Examined]) -> Mapping[str, object]:
    return {
        "heads": [PARAMETER_WORDS[name] for name in PARAMETERS],
        "weak": f"{100 * FLAT:g} %",
        "recordings": [{"name": rec.name, "rows": [_excitation(j) for j in rec.report.joints]} for rec in checked],
    }


def _excitation(joint: JointCheck) -> Mapping[str, object]:
    """Return a joint's row: for each parameter its share, and its standard deviation due to torque noise."""
    moved, cells = joint.excitation, []
    for name, unit in zip(PARAMETERS, UNITS, strict=True):
        share = moved.identifiability[name]
        sigma = (moved.sigma or {}).get(name)
        cells.append(
            {
                "share": f"{plain(100 * share, 2)} %",
                "strength": round(100 * float(np.sqrt(share))),
                "weak": share < FLAT,
                "sigma": f"±{plain(sigma, 2)} {unit.replace('m^2', 'm²')}"
                if sigma is not None and np.isfinite(sigma)
                else "",
            }
        )
    return {"name": joint.name, "still": moved.condition is None, "cells": cells}


def _contact(checked: Sequence[Examined]) -> Mapping[str, object]:
    touching = [rec for rec in checked if rec.report.contact is not None]
    reports = [rec.report.contact for rec in touching if rec.report.contact is not None]
    tracks = [rec.contact for rec in touching if rec.contact is not None]
    edges = ["0", *(f"{f:g}" for f in FORCES)]
    together_lines = said(reports[0], together(reports)) if len(reports) > 1 else []
    return {
        "plot": widget(("x", "y", "z"), WRENCH, tracks, [True] * 3) if tracks else None,
        "heads": [*(f"{a}–{b} N" for a, b in pairwise(edges)), f"over {edges[-1]} N"],
        "recordings": [
            {"name": rec.name, "lines": said(c), "rows": _regimes(c)} for rec, c in zip(touching, reports, strict=True)
        ],
        "together": together_lines,
    }


def _regimes(contact: ContactCheck) -> list[Mapping[str, object]]:
    """Return the seconds in each regime, in total and by contact force."""
    return [
        {
            "name": WORDS[name],
            "seconds": plain(seconds),
            "cells": [plain(s, 2) if s > 0 else "" for s in contact.forces.get(name, (0.0,) * (len(FORCES) + 1))],
        }
        for name, seconds in contact.seconds.items()
        if seconds > 0
    ]


def _cameras(checked: Sequence[Examined]) -> Mapping[str, object]:
    return {
        "recordings": [
            {"name": rec.name, "frames": rec.frames, "sheets": tables.cameras(rec.cameras, rec.excited)}
            for rec in checked
            if rec.cameras
        ]
    }


def _origin(checked: Sequence[Examined], repeats: Sequence[Mapping[str, object]], command: str) -> Mapping[str, object]:
    return {"command": command, "repeats": repeats, "recordings": [rec.report.recording for rec in checked]}
