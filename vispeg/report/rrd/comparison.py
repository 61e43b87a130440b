"""A comparison for the Rerun viewer: the measured arm and the model's, what each joint did, what the model misses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from vispeg.report.evidence import Evidence, Trace
from vispeg.report.rrd.stream import Stream, entity, stream

GHOST = 110  # of 255: how opaque the model's arm is
AFTER = np.array([10, 122, 117], np.uint8)


def write_comparison(path: Path, title: str, evidence: Evidence) -> Path:
    """Write the file; return the path. Raises UserError as `stream`."""
    with stream(path, title) as out:
        for trace in (*evidence.traces, *evidence.torques):
            _lines(out, trace, evidence.joints)
        for trace in evidence.traces:
            _arms(out, trace, evidence.arm)
        out.arrange(*_tabs(evidence))
    return path


def _lines(out: Stream, trace: Trace, joints: Sequence[str]) -> None:
    """Each joint's measured and predicted value, and the difference."""
    model = trace.before if trace.after is None else trace.after
    for j, joint in enumerate(joints):
        measured, predicted = trace.measured[:, j], model[:, j]
        out.lines((trace.name, trace.unit, joint), trace.time, {"measured": measured, "model": predicted})
        difference = {"measured - model": measured - predicted}
        out.lines((trace.name, f"residual {trace.unit}", joint), trace.time, difference)


def _arms(out: Stream, trace: Trace, arm: Mapping[str, np.ndarray]) -> None:
    """Give the measured arm, and the model's as a ghost where angles are compared."""
    model = trace.before if trace.after is None else trace.after
    angles = {"measured": (trace.measured, 255), "model": (model, GHOST)}
    if trace.unit != "rad":
        angles = {} if trace.posture is None else {"measured": (trace.posture, 255)}
    if not arm:
        return
    for name, (q, alpha) in angles.items():
        complete = np.isfinite(q).all(axis=1)
        pos, quat = posed(arm, q[complete])
        for body in np.unique(arm["body"]):
            rows = np.flatnonzero(arm["body"] == body)
            first, count = int(rows[0]), len(rows)
            faces = arm["face"][arm["body"][arm["face"][:, 0].astype(int)] == body].astype(np.int64) - first
            if faces.size and (faces.min() < 0 or faces.max() >= count):
                raise ValueError("vertices of a body do not stand together")
            colours = arm["colour"][rows] if alpha == 255 else np.tile(AFTER, (count, 1))
            at = entity(trace.name, "arm", name, f"body{body}")
            out.mesh(at, arm["vertex"][rows], faces, colours, alpha)
            out.place(at, trace.time[complete], pos[:, body], quat[:, body])


def posed(arm: Mapping[str, np.ndarray], q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions (T, nb, 3) m and quaternions (T, nb, 4) wxyz of the arm's bodies for joint angles (T, nj) rad.

    Args:
        arm: see `vispeg.report.live.arm.arm_arrays`, whose parents stand before their children.
        q: in the order of the evidence's joints.
    """
    count = len(arm["parent"])
    pos, quat = np.zeros((len(q), count, 3)), np.zeros((len(q), count, 4))
    quat[..., 0] = 1.0
    for body in range(1, count):
        parent = int(arm["parent"][body])
        at = pos[:, parent] + _turned(quat[:, parent], arm["pos"][body])
        turn = _product(quat[:, parent], np.tile(arm["quat"][body], (len(q), 1)))
        for k in np.flatnonzero(arm["joint"][:, 0] == body):
            axis, anchor = arm["axis"][k], arm["anchor"][k]
            fixed = at + _turned(turn, anchor)  # the anchor stays where it is
            half = (q[:, arm["joint"][k, 1]] - arm["zero"][k]) / 2
            turn = _product(turn, np.column_stack([np.cos(half), np.sin(half)[:, None] * axis]))
            at = fixed - _turned(turn, anchor)
        pos[:, body], quat[:, body] = at, turn
    return pos, quat


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Products (T, 4) of quaternions wxyz."""
    w, v = a[:, :1], a[:, 1:]
    scalar = w * b[:, :1] - np.sum(v * b[:, 1:], axis=1, keepdims=True)
    return np.concatenate([scalar, w * b[:, 1:] + b[:, :1] * v + np.cross(v, b[:, 1:])], axis=1)


def _turned(quat: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Give a vector (3,) turned by each of the quaternions (T, 4) wxyz."""
    v = quat[:, 1:]
    return vector + 2 * np.cross(v, np.cross(v, vector) + quat[:, :1] * vector)


def _tabs(evidence: Evidence) -> list[object]:
    import rerun.blueprint as rrb

    units = dict.fromkeys(t.unit for t in (*evidence.traces, *evidence.torques))
    tabs = []
    for trace in evidence.traces:
        charts = []
        for unit in units:
            charts.append(rrb.TimeSeriesView(origin=entity(trace.name, unit), name=f"measured and model, {unit}"))
            charts.append(
                rrb.TimeSeriesView(origin=entity(trace.name, f"residual {unit}"), name=f"measured − model, {unit}")
            )
        arm = [rrb.Spatial3DView(origin=entity(trace.name, "arm"), name="arm")] if evidence.arm else []
        tabs.append(rrb.Horizontal(*arm, rrb.Vertical(*charts), name=trace.name))
    return [rrb.Tabs(*tabs)]
