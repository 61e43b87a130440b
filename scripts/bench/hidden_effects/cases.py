"""The cases: every effect at three sizes on several joints, pairs, none, and disturbances that no library knows."""

from __future__ import annotations

import fnmatch
import hashlib
from dataclasses import dataclass, replace

import numpy as np
from arm import JOINTS
from hidden import Hide

from vispeg.core.errors import UserError
from vispeg.core.seeds import stream

SIZES = {"small": 0.3, "medium": 1.0, "large": 2.5}
SCORED, DEV = 20272, 4711  # seeds; any other is of development, too
TORQUE = np.array([2.0, 2.0, 1.2, 1.2, 0.3, 0.3, 0.06])  # N m: a medium friction or bias
DAMPING = np.array([4.0, 4.0, 2.5, 2.5, 0.5, 0.5, 0.06])  # N m s/rad
SPRING = np.array([6.0, 6.0, 4.0, 4.0, 0.6, 0.6, 0.08])  # N m/rad
ROTOR = np.array([0.6, 0.6, 0.25, 0.25, 0.02, 0.02, 0.002])  # kg m2 at the link side
COMPLIANCE = np.array([6e-5, 6e-5, 1e-4, 1e-4, 6e-4, 6e-4, 1e-3])  # rad/(N m)
PEAK = np.array([50.0, 95.0, 22.0, 38.0, 2.4, 1.9, 0.05])  # N m: typical peak of the nominal arm on these motions

# effect -> (joints of the standard list, joints that the full grid allows)
LOADED, ALL = ("joint2", "joint4"), JOINTS
GRID: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "coulomb_friction": (("joint2", "joint4", "joint7"), ALL),
    "viscous_friction": (("joint1", "joint6"), ALL),
    "stribeck_friction": (("joint3", "joint5"), ALL),
    "load_friction": (LOADED, ("joint1", "joint2", "joint3", "joint4", "joint6")),
    "hysteresis": (("joint1", "joint4"), ALL),
    "backlash": (("joint1", "joint3"), JOINTS[:6]),
    "joint_elasticity": (("joint2", "joint4"), JOINTS[:6]),
    "rotor_inertia": (("joint2", "joint5"), ALL),
    "cogging": (("joint1", "joint5"), ALL),
    "joint_bias": (("joint3", "joint6"), ALL),
    "cable_spring": (("joint4", "joint7"), ALL),
    "encoder_offset": (LOADED, ("joint2", "joint3", "joint4", "joint6")),
    "torque_gain": (LOADED, JOINTS[:6]),
    "torque_limit": (("joint1", "joint4"), JOINTS[:4]),
    "command_delay": (("joint3", "all"), (*JOINTS[:6], "all")),
    "actuator_lag": (("joint2", "joint6"), (*JOINTS[:6], "all")),
    "sensor_delay": (("joint4", "all"), (*JOINTS[:6], "all")),
    "encoder_quantization": (("joint2", "joint5"), (*ALL, "all")),
    "payload": (("flange",), ("flange",)),
    "link_mass": (("link3", "link6"), ("link2", "link3", "link4", "link5", "link6", "link7")),
    "link_com": (("link4", "link6"), ("link2", "link3", "link4", "link5", "link6", "link7")),
    "gravity_tilt": (("base",), ("base",)),
}
UNKNOWN: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "vibration": (("joint2", "joint4"), JOINTS[:6]),
    "warm_up": (("joint1", "joint3"), JOINTS[:6]),
    "rough_spot": (("joint2", "joint5"), JOINTS[:6]),
    "swaying_base": (("base",), ("base",)),
}
PAIRS = (
    ("coulomb_friction:joint2", "viscous_friction:joint2"), ("coulomb_friction:joint4", "payload:flange"),
    ("stribeck_friction:joint3", "joint_bias:joint6"), ("backlash:joint1", "coulomb_friction:joint3"),
    ("joint_elasticity:joint4", "coulomb_friction:joint4"), ("rotor_inertia:joint5", "viscous_friction:joint5"),
    ("gravity_tilt:base", "coulomb_friction:joint1"), ("link_mass:link4", "viscous_friction:joint1"),
    ("command_delay:all", "coulomb_friction:joint4"), ("torque_gain:joint2", "coulomb_friction:joint2"),
    ("cogging:joint1", "viscous_friction:joint3"), ("hysteresis:joint1", "joint_bias:joint4"),
    ("cable_spring:joint4", "coulomb_friction:joint6"), ("encoder_offset:joint2", "viscous_friction:joint4"),
    ("load_friction:joint2", "joint_bias:joint3"), ("torque_limit:joint1", "coulomb_friction:joint4"),
    ("payload:flange", "command_delay:all"), ("sensor_delay:joint4", "viscous_friction:joint2"),
    ("joint_elasticity:joint2", "payload:flange"), ("backlash:joint3", "rotor_inertia:joint5"),
    ("viscous_friction:joint1", "viscous_friction:joint4"), ("coulomb_friction:joint2", "coulomb_friction:joint5"),
    ("link_com:link6", "coulomb_friction:joint4"), ("encoder_quantization:joint2", "coulomb_friction:joint3"),
    ("actuator_lag:joint2", "joint_bias:joint4"),
)  # fmt: skip
NONE_COUNT = 40
MANY_COUNT, FEWEST, MOST, STRANGE = 40, 6, 20, 8  # cases with many effects; every eighth hides an unknown one too
SOFT_COUNT, SOFT_FEWEST, SOFT_MOST = 24, 15, 25  # cases of an arm under soft gains, whose joints stick
# what real arms have, with its weight: friction nearly everywhere, the rest here and there
ARM: dict[str, tuple[tuple[str, ...], float]] = {
    "coulomb_friction": (ALL, 4.0), "viscous_friction": (ALL, 4.0), "rotor_inertia": (ALL, 1.5),
    "joint_bias": (ALL, 1.5),
    "cogging": (ALL, 0.5), "cable_spring": (ALL, 0.3), "torque_gain": (JOINTS[:6], 0.5), "payload": (("flange",), 3.0),
    "link_mass": (("link3", "link4", "link5"), 0.7), "gravity_tilt": (("base",), 1.5), "command_delay": (("all",), 1.5),
}  # fmt: skip


@dataclass(frozen=True)
class Case:
    """What is hidden, how large, and how the arm is driven. `name` states it, `key` does not."""

    name: str
    hidden: tuple[Hide, ...]
    kind: str  # single | pair | none | unknown
    mode: str
    seed: int

    @property
    def key(self) -> str:
        """Folder name, which does not show what is hidden."""
        return hashlib.sha256(f"{self.seed}/{self.name}".encode()).hexdigest()[:10]


def parameters(effect: str, where: str, size: float, rng: np.random.Generator) -> dict[str, float]:
    """Draw an effect's parameters, SI, of `size` (0.3 small, 1 medium, 2.5 large) x 0.85 to 1.2; signs are random."""
    j = JOINTS.index(where) if where in JOINTS else 3
    k = size * rng.uniform(0.85, 1.2)
    sign, turn = rng.choice([-1.0, 1.0]), rng.uniform(-np.pi, np.pi)
    way = rng.standard_normal(3)
    way /= np.linalg.norm(way)
    late = 0.003 * k if where == "all" or j > 3 else 0.004 * k
    table = {
        "coulomb_friction": lambda: {"torque": TORQUE[j] * k},
        "viscous_friction": lambda: {"damping": DAMPING[j] * k},
        "stribeck_friction": lambda: {
            "coulomb": 0.7 * TORQUE[j] * k, "excess": 0.8 * TORQUE[j] * k, "velocity": rng.uniform(0.03, 0.1)},
        "load_friction": lambda: {"coefficient": 0.08 * k},
        "hysteresis": lambda: {"torque": TORQUE[j] * k, "stiffness": TORQUE[j] * k / rng.uniform(5e-3, 15e-3)},
        "backlash": lambda: {"gap": 2e-3 * k, "motor_inertia": 0.7 * ROTOR[j]},
        "joint_elasticity": lambda: {
            "compliance": COMPLIANCE[j] * k, "relaxation": rng.uniform(1.5e-3, 4e-3), "motor_inertia": 0.7 * ROTOR[j]},
        "rotor_inertia": lambda: {"inertia": ROTOR[j] * k},
        "cogging": lambda: {
            "amplitude": 0.6 * TORQUE[j] * k, "poles": float(rng.integers(10, 40)), "phase": turn},
        "joint_bias": lambda: {"torque": sign * 0.7 * TORQUE[j] * k},
        "cable_spring": lambda: {"stiffness": SPRING[j] * k, "reference": sign * rng.uniform(0.2, 0.5)},
        "encoder_offset": lambda: {"offset": sign * 0.012 * k},
        "torque_gain": lambda: {"gain": 1.0 + sign * 0.06 * k},
        "torque_limit": lambda: {"limit": PEAK[j] * (0.95 - 0.14 * k)},
        "command_delay": lambda: {"delay": late},
        "actuator_lag": lambda: {"time_constant": late},
        "sensor_delay": lambda: {"delay": late},
        "encoder_quantization": lambda: {"step": 6e-4 * k},
        "payload": lambda: {"mass": 0.6 * k, "x": 0.02 * way[0], "y": 0.02 * way[1], "z": rng.uniform(0.03, 0.09)},
        "link_mass": lambda: {"mass": 0.6 * k},
        "link_com": lambda: dict(zip("xyz", 0.016 * k * way, strict=True)),
        "gravity_tilt": lambda: {"roll": 0.025 * k * np.cos(turn), "pitch": 0.025 * k * np.sin(turn)},
        "vibration": lambda: {"amplitude": 3.0 * TORQUE[j] * k, "frequency": rng.uniform(6.0, 9.0)},
        "warm_up": lambda: {"torque": 2.0 * TORQUE[j] * k, "time_constant": rng.uniform(1.5, 3.0)},
        "rough_spot": lambda: {
            "torque": 3.0 * TORQUE[j] * k, "position": (0.0, 0.5, 0.0, -1.2, 0.0, 0.9, 0.0)[j] + 0.1 * sign,
            "width": 0.03},
        "swaying_base": lambda: {"angle": 0.03 * k, "frequency": rng.uniform(0.5, 0.9)},
    }  # fmt: skip
    return {key: float(value) for key, value in table[effect]().items()}


def _case(name: str, kind: str, places: list[tuple[str, str, float]], seed: int) -> Case:
    rng = stream(seed, "case", name)
    hidden = tuple(Hide(e, w, parameters(e, w, size, rng)) for e, w, size in places)
    broad = all(h.where in ("flange", "base", "all") for h in hidden)
    mode = rng.choice(["position", "torque", "osc"], p=[0.6, 0.25, 0.15] if broad else [0.75, 0.25, 0.0])
    return Case(name, hidden, kind, str(mode), seed)


def cases(seed: int = SCORED, grid: bool = False) -> list[Case]:
    """Return the standard list, or with `grid` every place of every effect."""
    out = []
    for kind, family in (("single", GRID), ("unknown", UNKNOWN)):
        for effect, (standard, allowed) in family.items():
            for where in allowed if grid else standard:
                out += [_case(f"{effect}/{where}/{s}", kind, [(effect, where, k)], seed) for s, k in SIZES.items()]
    for pair in PAIRS:
        places = [(*part.split(":"), 1.0) for part in pair]
        out.append(_case("pair/" + "+".join(pair).replace(":", "."), "pair", places, seed))
    return out + [_case(f"none/{i:02d}", "none", [], seed) for i in range(NONE_COUNT)]


def many(seed: int = SCORED) -> list[Case]:
    """Return cases of 6 to 20 effects at once, at 0.6 to 1.8 of a medium size."""
    out = []
    for i in range(MANY_COUNT):
        strange = i % STRANGE == STRANGE - 1
        out.append(_drawn(f"many/{i:02d}", stream(seed, "many", i), FEWEST, MOST, seed, strange))
    return out


def _drawn(
    name: str, rng: np.random.Generator, fewest: int, most: int, seed: int, strange: bool = False, mode: str = ""
) -> Case:
    """Draw a case of `fewest` to `most` effects, of what real arms have; with `strange` also an unknown one."""
    places = [(effect, where, weight) for effect, (targets, weight) in ARM.items() for where in targets]
    weights = np.array([weight for *_, weight in places])
    count = int(rng.integers(fewest, most + 1))
    chosen = rng.choice(len(places), size=count, replace=False, p=weights / weights.sum())
    hidden = [(*places[k][:2], float(rng.uniform(0.6, 1.8))) for k in sorted(chosen)]
    if strange:
        unknown = str(rng.choice(sorted(UNKNOWN)))
        hidden.append((unknown, str(rng.choice(UNKNOWN[unknown][1])), 1.0))
    case = _case(f"{name}-{count}", "strange" if strange else "many", hidden, seed)
    return replace(case, mode=mode) if mode else case


def soft(seed: int = SCORED) -> list[Case]:
    """Return cases of 15 to 25 effects under an eighth of the stiffness, drawn as `many`.

    Joints stick on slow motion and sag under errors of the masses.
    """
    return [
        _drawn(f"soft/{i:02d}", stream(seed, "soft", i), SOFT_FEWEST, SOFT_MOST, seed, mode="soft")
        for i in range(SOFT_COUNT)
    ]


def choose(only: tuple[str, ...], seed: int = SCORED, limit: int | None = None, group: str = "") -> list[Case]:
    """Return the standard list, or the cases of the full grid that match a pattern (`backlash/*/large`).

    At most `limit` of them, spread evenly. With a `group` (`many`, `soft`), its cases in place of list and grid.
    """
    found = GROUPS[group](seed) if group else cases(seed)
    if only:
        pool = found if group else cases(seed, grid=True)
        found = [c for c in pool if any(fnmatch.fnmatch(c.name, pattern) for pattern in only)]
        if not found:
            raise UserError("no case matches", got=" ".join(only), choices=sorted({c.name.split("/")[0] for c in pool}))
    if limit is not None and limit < len(found):  # evenly over the list, so that a short run still sees every kind
        found = [found[i] for i in np.linspace(0, len(found) - 1, limit).round().astype(int)]
    return found


GROUPS = {"many": many, "soft": soft}
