"""What is hidden in a plant: textbook parameters, SI, per row (recording) and joint, all at their null by default."""

from __future__ import annotations

from dataclasses import dataclass, field

import mujoco
import numpy as np
from arm import JOINTS, rigid

INF = np.inf
JOINT_NULLS = {
    # drive chain
    "delay": 0.0, "lag": 0.0, "gain": 1.0, "bias": 0.0, "limit": INF, "cog_amp": 0.0, "cog_n": 1.0, "cog_phase": 0.0,
    # friction at the motor side: LuGre level = fc + fs exp(-(v/vs)^2) + mu |gear torque| + bump + warm-up
    "fc": 0.0, "fs": 0.0, "vs": 1.0, "fv": 0.0, "mu": 0.0,
    "warm": 0.0, "warm_tau": 1.0, "bump": 0.0, "bump_at": 0.0, "bump_width": 1.0,
    # Bouc-Wen hysteresis
    "hyst": 0.0, "hyst_k": 1.0,
    # transmission: flexible where motor_inertia > 0; play is the full width of the dead zone
    "motor_inertia": 0.0, "stiffness": 3.0e4, "relaxation": 0.0, "play": 0.0, "rotor": 0.0,
    # link side
    "spring": 0.0, "spring_ref": 0.0, "vib": 0.0, "vib_hz": 0.0,
    # sensors
    "offset": 0.0, "sense_delay": 0.0, "step": 0.0,
}  # fmt: skip
SWAY = ("sway", "sway_hz")  # whole base


@dataclass(frozen=True)
class Hide:
    """One hidden thing: effect or disturbance name, where, its parameters under their public names, SI."""

    effect: str
    where: str
    params: dict[str, float] = field(default_factory=dict)


# effect -> {public parameter: plant parameter}
NAMES = {
    "coulomb_friction": {"torque": "fc"},
    "viscous_friction": {"damping": "fv"},
    "stribeck_friction": {"coulomb": "fc", "excess": "fs", "velocity": "vs"},
    "load_friction": {"coefficient": "mu"},
    "hysteresis": {"torque": "hyst", "stiffness": "hyst_k"},
    "rotor_inertia": {"inertia": "rotor"},
    "cogging": {"amplitude": "cog_amp", "poles": "cog_n", "phase": "cog_phase"},
    "joint_bias": {"torque": "bias"},
    "cable_spring": {"stiffness": "spring", "reference": "spring_ref"},
    "encoder_offset": {"offset": "offset"},
    "torque_gain": {"gain": "gain"},
    "torque_limit": {"limit": "limit"},
    "command_delay": {"delay": "delay"},
    "actuator_lag": {"time_constant": "lag"},
    "sensor_delay": {"delay": "sense_delay"},
    "encoder_quantization": {"step": "step"},
    "vibration": {"amplitude": "vib", "frequency": "vib_hz"},
    "warm_up": {"torque": "warm", "time_constant": "warm_tau"},
    "rough_spot": {"torque": "bump", "position": "bump_at", "width": "bump_width"},
}


def joint_parameters(rows: list[tuple[Hide, ...]]) -> dict[str, np.ndarray]:
    """Return the joint parameters of every row, each (nrow, 7); sway and sway_hz (nrow,)."""
    p = {key: np.full((len(rows), 7), null) for key, null in JOINT_NULLS.items()}
    p |= {key: np.zeros(len(rows)) for key in SWAY}
    for r, hidden in enumerate(rows):
        for item in hidden:
            _place(p, r, item)
    return p


def _place(p: dict[str, np.ndarray], r: int, item: Hide) -> None:
    if item.effect in ("payload", "link_mass", "link_com", "gravity_tilt"):
        return  # in the rigid body
    if item.effect == "swaying_base":
        p["sway"][r], p["sway_hz"][r] = item.params["angle"], item.params["frequency"]
        return
    cols = slice(None) if item.where == "all" else JOINTS.index(item.where)
    if item.effect == "joint_elasticity":
        p["stiffness"][r, cols] = 1.0 / item.params["compliance"]
        p["relaxation"][r, cols] = item.params["relaxation"]
        p["motor_inertia"][r, cols] = item.params["motor_inertia"]
    elif item.effect == "backlash":
        p["play"][r, cols] = item.params["gap"]
        p["motor_inertia"][r, cols] = item.params["motor_inertia"]
        p["relaxation"][r, cols] = 1.0e-3
    else:
        for public, value in item.params.items():
            p[NAMES[item.effect][public]][r, cols] = value


def rigid_body(hidden: tuple[Hide, ...]) -> mujoco.MjModel:
    """Return the arm with what is hidden in its bodies and its mounting."""
    mass, com, payload, tilt = {}, {}, None, (0.0, 0.0)
    for item in hidden:
        v = item.params
        if item.effect == "payload":
            payload = (v["mass"], np.array([v["x"], v["y"], v["z"]]))
        elif item.effect == "link_mass":
            mass[item.where] = v["mass"]
        elif item.effect == "link_com":
            com[item.where] = np.array([v["x"], v["y"], v["z"]])
        elif item.effect == "gravity_tilt":
            tilt = (v["roll"], v["pitch"])
    return rigid(mass, com, payload, tilt)
