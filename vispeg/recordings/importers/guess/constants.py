"""Look up torque constants of joints, N m/A: stated by the user or published for an arm or servo, with the source."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from vispeg.core.errors import UserError
from vispeg.formats.yaml_data import read_yaml

FILE = Path(__file__).with_name("torque_constants.yaml")
KEY = "--torque-constants"
EXPECTED = "N m/A at the joint (motor constant x gear): a number a joint, JOINT=NUMBER, or the name of an arm or servo"


@dataclass(frozen=True)
class Constant:
    """Torque constant of a joint.

    Attributes:
        value: N m/A, above 0.
        source: where the value comes from.
    """

    value: float
    source: str


@cache
def published() -> Mapping[str, Any]:
    """Return the file of published constants: `arms`, `sensors` and `motors`."""
    return read_yaml(FILE)


def names() -> list[str]:
    """List the arms and servos whose constants are known."""
    return [*published()["arms"], *published()["motors"]]


def of_arm(called: str, joints: Sequence[str]) -> dict[str, Constant]:
    """Return the published constants of an arm's joints.

    Args:
        called: text with the robot's name, file and model, in any order.
        joints: the robot's joint names, which may carry a prefix that the published names lack.

    Returns:
        Joint -> constant; empty where no constant of that arm is known.
    """
    for name, arm in published()["arms"].items():
        if not _named(name, called):
            continue
        found = {joint: k for joint in joints for key, k in arm["motor"].items() if joint.endswith(key)}
        return {joint: Constant(float(f"{k * arm['gear']:.4g}"), arm["source"]) for joint, k in found.items()}
    return {}


def torque_sensor_of(called: str) -> str | None:
    """Return the source which states that an arm of this name measures torque after the gear; None if there is none."""
    sensors = published()["sensors"]
    return next((sensors[name]["source"] for name in sensors if _named(name, called)), None)


def stated(texts: Sequence[str], joints: Sequence[str]) -> dict[str, Constant]:
    """Parse the torque constants that a user states.

    Args:
        texts: one number per joint in the robot's order; JOINT=NUMBER or JOINT=SERVO; or the name of one arm or servo.
        joints: the robot's.

    Raises:
        UserError: the count differs from that of the joints, an invalid number, or an unknown name.
    """
    if len(texts) == 1 and "=" not in texts[0] and not _is_number(texts[0]):
        name = texts[0]
        arm = published()["arms"].get(name.lower())
        if arm is None:
            return {joint: _constant(name) for joint in joints}
        known = of_arm(name, joints)
        if known:
            return known
        if len(arm["motor"]) != len(joints):
            expected = f"an arm with {', '.join(arm['motor'])}"
            raise UserError(
                f"{name}'s constants are of other joints", key=KEY, expected=expected, got=", ".join(joints)
            )
        return dict(zip(joints, of_arm(name, [*arm["motor"]]).values(), strict=True))
    if any("=" in text for text in texts):
        out = {}
        for text in texts:
            joint, equals, value = text.partition("=")
            if not equals or joint not in joints or joint in out:
                said = "is stated twice" if joint in out else "is no joint of the robot"
                raise UserError(said, key=KEY, got=text, expected="JOINT=NUMBER", choices=list(joints))
            out[joint] = _constant(value)
        return out
    if len(texts) != len(joints):
        raise UserError("not a number a joint", key=KEY, expected=f"{len(joints)} numbers", got=len(texts))
    return {joint: _constant(text) for joint, text in zip(joints, texts, strict=True)}


def _constant(text: str) -> Constant:
    """Return the constant of a text: a number in N m/A, or a servo's name. Raises UserError: neither."""
    if _is_number(text):
        if not 1e-4 <= float(text) <= 1e4:
            raise UserError("no torque constant", key=KEY, expected="0.0001 to 10000 N m/A", got=text)
        return Constant(float(text), "stated")
    motors = {name.lower(): (name, data) for name, data in published()["motors"].items()}
    found = next((motors[name] for name in motors if text.lower().startswith(name)), None)
    if found is None:
        raise UserError("not known", key=KEY, expected=EXPECTED, got=text, choices=names())
    name, data = found
    at = f"{name} at stall, {data['torque']:g} N m at {data['current']:g} A and {data['volt']:g} V"
    return Constant(float(f"{data['torque'] / data['current']:.4g}"), f"{at}: {data['source']}")


def _named(name: str, called: str) -> bool:
    return re.search(rf"(?<![a-z0-9]){name}(?![a-z0-9])", called.lower()) is not None


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
