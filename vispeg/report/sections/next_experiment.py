"""The section on the next experiment: the motion to record, what it distinguishes, its picture, and the command."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import PurePath
from typing import TYPE_CHECKING

import numpy as np

from vispeg.core.lines import thin
from vispeg.report.drawings.figures import MEASURED, MUTED, RIVALS, Shape, chart, legend, new_figure, quiet
from vispeg.report.evidence import Evidence, NextMotion
from vispeg.report.record import Record
from vispeg.report.text import words
from vispeg.report.text.quantities import number, plain, prefix, quantity, rms

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TITLE = "Next experiment"
MOST_JOINTS = 4  # most joints in the picture


def context(record: Record) -> Mapping[str, object]:
    """Return the motion, its reason, the expected separation in sigma, picture, and the command to run afterwards."""
    following = record.mapping("next_experiment")
    sigma = number(following.get("expected_separation_sigma"))
    motion = record.evidence.next_motion
    proposed = str(following.get("motion") or "").rstrip(".")
    tossed = bool(record.values.get("object"))
    return {
        "motion": proposed,
        "why": str(following.get("why") or "").rstrip("."),
        "sigma": plain(sigma, 2) if sigma and proposed else "",  # zero: not predicted
        "weak": bool(sigma) and sigma < 3,
        "file": str(following.get("file") or ""),
        "how": str(following.get("how") or (BY_HAND if tossed else "")),
        "command": again(record, bool(proposed or not following)) if proposed or tossed else VALIDATE,
        "price": words.price(record.values),
        "paid": words.paid(record.values),
        "onward": words.onward(record.values),
        "picture": motion_picture(motion, record.evidence) if motion is not None else "",
        "seconds": plain(motion.time[-1] - motion.time[0]) if motion is not None and motion.time.size else "",
        "own": _command(record)[1:2] == ["demo"],
    }


BY_HAND = "Drop the object by hand from other heights or onto another part of the table, and record its pose"
VALIDATE = "vispeg compare model.yaml --recording NEW-RECORDING --out compared"
GENERAL = "vispeg diagnose MODEL --recording DIR --recording NEW-RECORDING --validate DIR --out OUT-2"


def _command(record: Record) -> list[str]:
    """Return the words of the command that made the record; empty if unknown."""
    command = record.mapping("provenance").get("command")
    try:
        return [str(w) for w in command] if isinstance(command, list) else shlex.split(str(command or ""))
    except ValueError:  # unbalanced quotes, so not a command line
        return []


def again(record: Record, new: bool = True) -> str:
    """Return this diagnosis's command with another --out and, if `new`, a new recording; if unknown, a general one."""
    command = _command(record)
    if command[1:2] != ["diagnose"]:  # another command has other arguments
        return GENERAL
    for i, word in enumerate(command):
        if word == "--out" and i + 1 < len(command):
            command[i + 1] = f"{PurePath(command[i + 1])}-2"
        elif word.startswith("--out="):
            command[i] = f"--out={PurePath(word.removeprefix('--out='))}-2"
    return shlex.join(command) + (" --recording NEW-RECORDING" if new else "")


def motion_picture(motion: NextMotion, evidence: Evidence) -> str:
    """Draw the commands of moving joints, beside the difference between the predictions of the two top rivals."""
    joints = evidence.joints
    spread = np.ptp(np.nan_to_num(motion.command), axis=0) if motion.time.size else np.zeros(len(joints))
    apart = None if motion.a is None or motion.b is None else motion.a - motion.b
    size = spread if apart is None else np.array([rms(apart[:, j]) or 0.0 for j in range(len(joints))])
    chosen = sorted(np.argsort(-size, kind="stable")[:MOST_JOINTS].tolist())
    chosen = [j for j in chosen if spread[j] > 0 or size[j] > 0]
    if not chosen:
        return ""
    text = "The proposed motion, and the difference between the rivals' predictions"
    return chart(lambda shape: _figure(motion, apart, evidence, chosen, shape), "next", text)


def _figure(
    motion: NextMotion, apart: np.ndarray | None, evidence: Evidence, chosen: list[int], shape: Shape
) -> Figure:
    charts = 1 if apart is None else 2  # per joint
    columns = 1 if shape.narrow else charts
    figure = new_figure(0.75 + 1.0 * len(chosen) * charts / columns, shape.width)
    grid = figure.subplots(len(chosen) * charts // columns, columns, sharex=True, squeeze=False).reshape(
        len(chosen), charts
    )
    for row, j in zip(grid, chosen, strict=True):
        row[0].plot(*thin(motion.time, motion.command[:, j]), color=MEASURED, linewidth=1.2)
        row[0].set_title(f"{evidence.joints[j]} command (rad)", color=MEASURED, pad=3)
        if apart is not None:
            factor, unit = prefix(float(np.nanmax(np.abs(apart[:, j]), initial=0.0)), evidence.unit)
            row[1].axhline(0.0, color=MUTED, linewidth=0.6)
            row[1].plot(*thin(motion.time, factor * apart[:, j]), color=RIVALS[0], linewidth=1.1)
            row[1].set_title(f"difference of rivals ({unit})", color=MUTED, pad=3)
            row[1].set_title(f"RMS {quantity(rms(apart[:, j]), evidence.unit)}", loc="right", pad=3)
        for ax in row:
            quiet(ax)
            ax.locator_params(axis="y", nbins=4)
    for ax in grid[-1][-columns:]:
        ax.set_xlabel("time (s)")
    entries = {"command": (MEASURED, "-")}
    if apart is not None:
        entries["difference between the two rivals' predictions"] = (RIVALS[0], "-")
    legend(figure, entries)
    return figure
