"""Parse column names: quantity, measured or commanded, unit, joint."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Literal

UNITS = (  # (unit, pattern of its spellings in lower case); the longest match in a name counts
    ("rad/s", r"rad[_/]?s|radps|rad_per_s(ec)?|rad_sec"),
    ("deg/s", r"deg[_/]?s|degps|dps|deg_per_s(ec)?|deg_sec|°/s"),
    ("rpm", r"rpm"),
    ("mNm", r"mnm|m_nm|mn[·⋅*-]m|millinewtonmeters?"),
    ("N cm", r"ncm|n_cm"),
    ("N m", r"nm|n[_·⋅*-]m|newton[_-]?met(er|re)s?"),
    ("mrad", r"mrad"),
    ("mdeg", r"mdeg|millideg(rees)?"),
    ("rad", r"rad(ians?)?"),
    ("deg", r"deg(rees?)?|grad|°"),
    ("turn", r"turns?|revs?|revolutions?"),
    ("ms", r"ms|msecs?|millis|milliseconds?"),
    ("us", r"us|µs|usecs?|micros|microseconds?"),
    ("ns", r"ns|nsecs?|nanos|nanosec|nanoseconds?"),
    ("s", r"secs?|seconds?"),
    ("mm", r"mm"),
    ("m/s", r"m[_/]s|mps|m_per_s(ec)?"),
    ("mm/s", r"mm[_/]s|mm_per_s(ec)?"),
    ("%", r"%|percent|pct"),
)
LONE_S = r"[\[({]\s*s\s*[\])}]|(?<![a-z0-9µ°/])s(?=[\s\])}]*$)"  # in brackets, or at the end of a name
TIMES = {"ms", "us", "ns", "s"}
OF_UNIT = {  # unit -> the quantity that it implies
    **dict.fromkeys(("rad", "deg", "mrad", "mdeg", "turn"), "q"),
    **dict.fromkeys(("rad/s", "deg/s", "rpm"), "dq"),
    **dict.fromkeys(("N m", "mNm", "N cm"), "tau"),
}
TIME = {"t", "time", "timestamp", "stamp", "timestep", "clock", "elapsed", "zeit", "zeitstempel", "uhrzeit"}
POSITION = {"q", "pos", "position", "positions", "angle", "angles", "theta", "jpos", "winkel", "state", "phi",
            "qpos"}  # fmt: skip
VELOCITY = {"dq", "qd", "vel", "velocity", "velocities", "speed", "speeds", "omega", "qdot", "geschwindigkeit",
            "qvel"}  # fmt: skip
TORQUE = {"tau", "trq", "tq", "torque", "torques", "effort", "efforts", "moment", "moments", "load", "drehmoment"}
AMPERES = {"ma": "mA", **dict.fromkeys(("milliamp", "milliamps", "milliampere", "milliamperes"), "mA"),
           **dict.fromkeys(("amp", "amps", "ampere", "amperes"), "A")}  # fmt: skip
OTHER = {  # quantity -> words that name it, and the reason why it is not used
    "acceleration": ({"ddq", "qdd", "acc", "acceleration", "accelerations", "beschleunigung"},
                     "accelerations are not used"),
    # `ma` is a unit in the name of a current, but does not name a current by itself
    "current": ({"current", "currents", "curr", "macur", "iq", "strom", *AMPERES} - {"ma"}, "measured torque is there, "
                "so that currents are not used"),
    "external": ({"ext", "external"}, "an estimate of external torque, not what the joint felt"),
    "temperature": ({"temp", "temps", "temperature", "temperatures", "temperatur"}, "temperatures are not used"),
    "voltage": ({"voltage", "voltages", "volt", "spannung"}, "voltages are not used"),
    "error": ({"error", "err", "fehler"}, "a difference follows from the others"),
    "raw": ({"counts", "ticks", "raw", "pwm"}, "raw counts: their scale is not known"),
    "tool": ({"tcp", "cartesian"}, "a pose, speed or force of the tool, not of a joint"),
    "share": (set[str](), "in % of an unknown value; a map can name it load.JOINT if it is a torque"),
    "jerk": ({"jerk", "dtau"}, "derivatives are not used"),
}  # fmt: skip
COMMANDED = {"cmd", "command", "commanded", "commands", "des", "desired", "target", "targets", "setpoint", "setpoints",
             "goal", "goals", "ref", "reference", "action", "soll", "sollwert", "sp"}  # fmt: skip
MEASURED = {"act", "actual", "meas", "measured", "ist", "istwert", "state", "fb", "feedback", "present",
            "observation", "observations", "obs"}  # fmt: skip
WHOLE = {  # words of KUKA's RSI that state both the quantity and whether it is measured or commanded
    "aipos": ("q", False), "aspos": ("q", True), "axisact": ("q", False), "axisactmeas": ("q", False),
}  # fmt: skip
RATE_OF = {"q": "dq", "dq": "acceleration", "acceleration": "jerk", "tau": "jerk"}  # quantity -> its derivative
DOTS = {"dot": 1, "ddot": 2}  # word -> how many times a name's quantity is differentiated
NO_JOINT = {"tcp", "rx", "ry", "rz", "camera", "gyro", "imu"}  # columns that have a unit but belong to no joint
# words that neither state anything nor identify a joint
FILL = {"field", "data", "value", "values", "robot", "arm", "joint", "joints", "axis", "axes", "states", "j", "motor",
        "measuredjoint", "commandedjoint", "msg", "lbr", "js", "gelenk", "achse", "ee", "hat", "filtered"}  # fmt: skip


@dataclass(frozen=True)
class Meaning:
    """The meaning of one column name.

    Attributes:
        name: the column.
        quantity: q, dq, tau, time, episode, or a key of OTHER; empty if the name tells none.
        commanded: True for commanded, False for measured, None if the name does not tell.
        unit: of `importers.mapping.FACTORS` or `UNITS`, or empty.
        label: the rest of the name, which identifies the joint.
        said: what states the quantity: a word of the name, its unit in brackets, or a sentence if the name does not.
        by: whether a word of the name, its unit, or something else (`other`) states the quantity.
    """

    name: str
    quantity: str
    commanded: bool | None
    unit: str
    label: str
    said: str
    by: Literal["word", "unit", "other"] = "word"


def meaning(name: str, labels: dict[str, str]) -> Meaning:
    """Parse a column name.

    Words decide first; a unit decides the quantity where no word does.

    Args:
        name: the column.
        labels: column -> joint, for columns whose joint is known from elsewhere.
    """
    unit, rest = _unit(_with_ampere_as_word(name))
    words = split(rest)
    if "episode" in words:
        return Meaning(name, "episode", None, "", "", "episode")
    quantity, said, taken = _quantity(words)
    by: Literal["word", "unit"] = "word"
    if quantity == "current":
        spelt = [i for i, word in enumerate(words) if word in AMPERES]
        unit, taken = (AMPERES[words[spelt[0]]] if spelt else ""), taken | {*spelt}
    if unit == "%" and quantity:
        quantity, said = "share", unit
    if not words and unit in TIMES and name.lower() != "s":  # `seconds`; a column `s` may as well be a length
        quantity, said, by = "time", f"[{unit}]", "unit"
    commanded: bool | None = None
    for i, word in enumerate(words):
        desired = word == "d" and quantity in ("q", "dq", "tau")  # Franka: q_d, tau_J_d
        if word in COMMANDED or desired or (word in WHOLE and WHOLE[word][1]):
            commanded, taken = True, taken | {i}
        elif commanded is None and word in {*MEASURED, *WHOLE}:
            commanded, taken = False, taken | {i}
    if commanded is None and not quantity and unit in OF_UNIT and not set(words) & NO_JOINT:
        quantity, said, by = OF_UNIT[unit], f"[{unit}]", "unit"  # `M1 [Nm]`
    if commanded is not None and not quantity:  # `goal_rad`, `action`: only the unit tells the quantity
        quantity, said = OF_UNIT.get(unit, "q" if "action" in words else ""), "commanded" if commanded else "measured"
    label = [w for i, w in enumerate(words) if i not in taken and w not in FILL | MEASURED | COMMANDED]
    return Meaning(name, quantity, commanded, unit, labels.get(name) or "_".join(label), said, by)


def _quantity(words: Sequence[str]) -> tuple[str, str, set[int]]:
    """Return the quantity that words name, the word that names it, and the indices of the words used; empty if none.

    The first such word counts; `state` counts only if there is no other. Words of WHOLE, then of OTHER, override it.
    """
    quantity, said, taken = "", "", set()
    for i, word in enumerate(words):
        for kind, vocabulary in (("time", TIME), ("q", POSITION), ("dq", VELOCITY), ("tau", TORQUE)):
            if word in vocabulary and (not quantity or quantity == "q" and said == "state"):
                quantity, said = kind, word
                taken.add(i)
        if word in WHOLE:
            quantity, said = WHOLE[word][0], word
            taken.add(i)
    for i, word in enumerate(words):
        for _ in range(DOTS.get(word, 0) if quantity in RATE_OF else 0):  # `q_dot`, `thetaDot`
            quantity, said = RATE_OF.get(quantity, quantity), f"{said}_dot"
            taken.add(i)
    for kind, (vocabulary, _) in OTHER.items():
        named = [word for word in words if word in vocabulary]
        if named:
            quantity, said = kind, named[0]
    return quantity, said, taken


def _with_ampere_as_word(name: str) -> str:
    """Return a name with its unit A or mA, whose case matters, as a word that does not depend on case."""
    hit = ampere(name)
    if hit is None:
        return name
    return f"{name[: hit.start()]}_{'milliamp' if 'm' in hit[0] else 'amp'}_{name[hit.end() :]}"


def ampere(name: str) -> re.Match[str] | None:
    """Find the unit A or mA in a name.

    A lone A counts in brackets, or next to a number in the name of a current: joints are called A, too.
    """
    hit = re.search(r"[\[(]\s*m?A\s*[\])]|(?<![A-Za-z0-9])mA(?![A-Za-z0-9])", name)
    if hit is None and {*split(name)} & OTHER["current"][0]:
        hit = re.search(r"(?<=\d[_ ])A(?![A-Za-z0-9])|(?<![A-Za-z0-9])A(?=[_ ]\d)", name)
    return hit


def bare(name: str) -> str:
    """Return a name without its unit."""
    return _unit(name)[1]


def split(name: str) -> list[str]:
    """Split a name into words and numbers in lower case: `MeasuredJoint_A1` -> measured, joint, a, 1."""
    apart = re.sub(r"(?<=[a-zäöü0-9])(?=[A-ZÄÖÜ])", " ", name)
    return [word.lower() for word in re.findall(r"[A-Za-zÄÖÜäöüß]+|\d+", apart)]


def _unit(name: str) -> tuple[str, str]:
    """Return the unit in a name, and the name without it. A lone `s` is a unit in brackets or at the end of a name."""
    flat = re.sub(r"[\s\[\](){}.,:]+", "_", name.lower())
    hits = [
        (end - start, unit, start, end)
        for unit, pattern in UNITS
        for start, end in [hit.span() for hit in re.finditer(rf"(?<![a-z0-9µ°])({pattern})(?![a-z])", flat)][-1:]
    ]  # the last place of each unit
    if hits:
        _, unit, start, end = max(hits, key=itemgetter(0))
        # `start` and `end` are places in `flat`; `name`, if as long, keeps the case by which `split` divides words
        whole = name if len(flat) == len(name) else flat
        return unit, whole[:start] + "_" + whole[end:]
    if hit := re.search(LONE_S, name.lower()):
        return "s", name[: hit.start()] + "_" + name[hit.end() :]
    return "", name
