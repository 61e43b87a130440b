"""The cases: every effect at two sizes, pairs, none, and what no library knows. Deterministic by seed."""

from __future__ import annotations

import fnmatch
import hashlib
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from contact_plant import DAMP, HOLD, STIFF, Truth

SCORED, DEV = 31415, 2718  # seeds; any other is of development, too
NONE_COUNT = 20
MM, DEG = 1e-3, np.pi / 180
# label -> (effect, place, sizes: {parameter: value} of each)
GRID: dict[str, tuple[str, str, tuple[dict[str, float], ...]]] = {
    "friction": ("contact_friction", "peg", ({"scale": 1.7}, {"scale": 0.5})),
    "stiffness": ("contact_stiffness", "peg", ({"scale": 0.1}, {"scale": 0.04})),
    "damping": ("contact_damping", "peg", ({"scale": 0.25}, {"scale": 0.05})),
    "hole-x": ("hole_offset", "fixture", ({"x": 0.8 * MM}, {"x": -0.4 * MM})),
    "hole-y": ("hole_offset", "fixture", ({"y": -0.8 * MM}, {"y": 0.4 * MM})),
    "hole-z": ("hole_offset", "fixture", ({"z": 0.8 * MM}, {"z": -0.5 * MM})),
    "tilt": ("hole_tilt", "fixture", ({"roll": 1.2 * DEG}, {"pitch": -0.6 * DEG})),
    "clearance": ("hole_clearance", "fixture", ({"width": -1.2 * MM}, {"width": -0.6 * MM})),
    "fixture-x": ("fixture_compliance", "fixture", ({"x": 6e-5}, {"x": 3e-5})),
    "fixture-z": ("fixture_compliance", "fixture", ({"z": 3e-5}, {"z": 1.5e-5})),
    "rocking": ("fixture_compliance", "fixture", ({"roll": 8e-3}, {"pitch": 3e-3})),
    "grasp": ("peg_grasp_compliance", "peg", ({"x": 8e-5, "y": 8e-5}, {"roll": 2e-2, "pitch": 2e-2})),
    "grip-xy": ("grip_pose", "peg", ({"x": 0.8 * MM}, {"y": -0.5 * MM})),
    "grip-z": ("grip_pose", "peg", ({"z": 1.0 * MM}, {"z": -0.6 * MM})),
    "grip-tilt": ("grip_pose", "peg", ({"roll": 1.5 * DEG}, {"pitch": -0.8 * DEG})),
    "slip": ("gripper_slip", "peg", ({"grip": 0.3}, {"grip": 0.6})),
    "tool": ("tool_mass", "gripper", ({"mass": 0.25}, {"mass": 0.1})),
    "com": ("tool_com", "gripper", ({"x": 8 * MM}, {"y": -4 * MM})),
    "object": ("object_mass", "peg", ({"scale": 2.0}, {"scale": 0.4})),
    "bias": ("wrench_bias", "flange", ({"fx": 1.5, "fz": -1.0}, {"ty": 0.12})),
    "gain": ("wrench_gain", "flange", ({"gain": 1.12}, {"gain": 0.94})),
    "delay": ("wrench_delay", "flange", ({"delay": 0.02}, {"delay": 0.01})),
}
PAIRS = (
    ("friction", "fixture-x"), ("friction", "hole-x"), ("hole-y", "clearance"), ("fixture-z", "friction"),
    ("tool", "friction"), ("bias", "hole-z"), ("grip-xy", "friction"), ("tilt", "hole-x"), ("slip", "friction"),
    ("clearance", "fixture-x"), ("delay", "friction"), ("rocking", "hole-z"),
)  # fmt: skip
UNKNOWN: dict[str, tuple[dict[str, float], ...]] = {
    "chip": ({"bump": 1.2 * MM}, {"bump": 0.8 * MM}, {"bump": 1.6 * MM}),
    "gasket": ({"pad": 1.5 * MM}, {"pad": 1.0 * MM}, {"pad": 2.0 * MM}),
    "stick-slip": ({"stick": 2.5}, {"stick": 2.0}, {"stick": 3.0}),
    "loose": ({"play": 0.5 * MM}, {"play": 0.35 * MM}, {"play": 0.7 * MM}),
}


@dataclass(frozen=True)
class Case:
    """What is hidden; `name` states it, `key` does not."""

    name: str
    kind: str  # single | pair | none | unknown
    hidden: list[dict[str, Any]]
    truth: Truth
    seed: int

    @property
    def key(self) -> str:
        """Folder name, which does not show what is hidden."""
        return hashlib.sha256(f"{self.seed}/{self.name}".encode()).hexdigest()[:10]


AXES = {
    "hole_offset": ("offset", "xyz"), "hole_tilt": ("tilt", ("roll", "pitch")),
    "fixture_compliance": ("fixture", ("x", "y", "z", "roll", "pitch")),
    "peg_grasp_compliance": ("grasp", ("x", "y", "z", "roll", "pitch")),
    "grip_pose": ("grip", ("x", "y", "z", "roll", "pitch")), "tool_com": ("com", "xyz"),
    "wrench_bias": ("bias", ("fx", "fy", "fz", "tx", "ty", "tz")),
}  # fmt: skip
SCALES = {
    "contact_friction": ("friction", 0.3),
    "contact_stiffness": ("stiffness", STIFF),
    "contact_damping": ("damping", DAMP),
    "gripper_slip": ("hold", HOLD),
    "object_mass": ("object", 1.0),
}
PLAIN = {"hole_clearance": "width", "tool_mass": "tool", "wrench_gain": "gain", "wrench_delay": "delay"}


def hide(truth: Truth, effect: str, params: dict[str, float]) -> Truth:
    """Return the plant with one more effect."""
    if effect in AXES:
        field, axes = AXES[effect]
        values = list(getattr(truth, field))
        for name, value in params.items():
            values[list(axes).index(name)] += value
        return replace(truth, **{field: tuple(values)})
    (value,) = params.values()
    if effect in SCALES:
        field, nominal = SCALES[effect]
        return replace(truth, **{field: nominal * value})
    return replace(truth, **{PLAIN[effect]: value})


def cases(seed: int = SCORED) -> list[Case]:
    """Return all cases, in the order of the tables."""
    out = []

    def add(name: str, kind: str, parts: list[tuple[str, int]], extra: dict[str, float] | None = None) -> None:
        truth, hidden = replace(Truth(), **(extra or {})), []
        for label, size in parts:
            effect, where, sizes = GRID[label]
            draw = np.random.default_rng([seed, size, *label.encode()]).uniform(0.9, 1.1)
            params = {k: spread(v, draw, effect) for k, v in sizes[size].items()}
            truth = hide(truth, effect, params)
            hidden.append({"effect": effect, "where": where, "params": params})
        out.append(Case(name, kind, hidden, truth, seed))

    for label in GRID:
        for size, word in enumerate(("large", "small")):
            add(f"{label}/{word}", "single", [(label, size)])
    for a, b in PAIRS:
        add(f"pair/{a}+{b}", "pair", [(a, 0), (b, 0)])
    for i in range(NONE_COUNT):
        add(f"none/{i:02d}", "none", [])
    for label, sizes in UNKNOWN.items():
        for i, extra in enumerate(sizes):
            add(f"unknown/{label}/{i}", "unknown", [], extra)
    return out


def spread(value: float, draw: float, effect: str) -> float:
    """Return a value times a random factor `draw`; of a wrench gain, its distance from 1 is multiplied."""
    if effect == "wrench_gain":
        return 1 + (value - 1) * draw
    return value * draw


def choose(patterns: tuple[str, ...], seed: int, limit: int | None) -> list[Case]:
    """Return the cases whose name fits a pattern (all without one), at most `limit` of them, spread evenly.

    Raises:
        ValueError: no such case.
    """
    found = [c for c in cases(seed) if not patterns or any(fnmatch.fnmatch(c.name, p) for p in patterns)]
    if not found:
        raise ValueError(f"no case fits {' '.join(patterns)}; --list shows them")
    if limit is not None and limit < len(found):
        found = [found[i] for i in np.linspace(0, len(found) - 1, limit).astype(int)]
    return found
