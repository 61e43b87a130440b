"""A tool in the form of a recording: mass, centre of mass and diagonal inertia, also for tools given by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypedDict

import mujoco
import numpy as np

from vispeg.robots.model import Tool, load


def declared(robot: str, tool: Tool) -> Mapping[str, object] | None:
    """Return a tool as `recording.yaml` states it (docs/formats.md); None for no tool.

    Numbers are in kg, m and kg m^2 about the centre of mass, along the flange's axes. The bodies of a named tool are
    combined by the parallel axis theorem. Products of inertia are dropped, as the form cannot state them; they are zero
    for the built-in tools.
    """
    if tool is None or tool == "none":
        return None
    if not isinstance(tool, str):
        return dict(tool)
    return {**carried(load(robot, tool=tool).compile()), "name": tool}


class Carried(TypedDict):
    """Mass (kg), centre of mass (3,) m and diagonal inertia about it (3,) kg m^2, along the flange's axes."""

    mass_kg: float
    com_m: list[float]
    inertia_kgm2: list[float]


def carried(model: mujoco.MjModel) -> Carried:
    """Return the load at the flange of a compiled arm with a body `tool`; without mass, its centre is the flange."""
    root = model.body("tool").id
    parts = []
    for b in range(model.nbody):
        if b != root and int(model.body_parentid[b]) != root:
            continue
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, model.body_iquat[b])
        turn = turn.reshape(3, 3)
        at = model.body_ipos[b] + (0.0 if b == root else model.body_pos[b])
        parts.append((model.body_mass[b], at, turn @ np.diag(model.body_inertia[b]) @ turn.T))
    mass = float(sum(p[0] for p in parts))
    com = np.sum([p[0] * p[1] for p in parts], axis=0) / (mass or 1.0)  # no mass: its centre is the origin
    inertia = np.zeros((3, 3))
    for m, at, central in parts:
        d = at - com
        inertia += central + m * (d @ d * np.eye(3) - np.outer(d, d))
    return {"mass_kg": mass, "com_m": com.tolist(), "inertia_kgm2": np.diag(inertia).tolist()}
