"""Write a proposed map as YAML with its reasons, and advise which further information would allow more."""

from __future__ import annotations

from typing import Any

import yaml

from vispeg.recordings.importers.guess.propose import Line, Proposal
from vispeg.recordings.tables.table import Dialect

MOST_UNUSED = 12  # unused columns that are listed individually


def data(proposal: Proposal) -> dict[str, object]:
    """Return the map as plain data, in the form that `importers.mapping.map_from` reads."""
    out: dict[str, object] = {}
    if proposal.dialect != Dialect():
        table: dict[str, object] = {"separator": proposal.dialect.separator, "decimal": proposal.dialect.decimal}
        out["table"] = table if not proposal.dialect.names else table | {"columns": [*proposal.dialect.names]}
    for line in proposal.lines:
        out[line.target] = _entry(line)
    if proposal.motors:
        out["motors"] = proposal.motors
    if proposal.recording:
        out["recording"] = proposal.recording
    return out


def _entry(line: Line) -> dict[str, object] | str:
    if line.rate_hz is not None:
        return {"rate_hz": line.rate_hz}
    if not line.column:
        return "none"
    entry: dict[str, object] = {"column": line.column}
    entry |= {"unit": line.unit} if line.unit else {}
    entry |= {"scale": line.scale} if line.scale != 1.0 else {}
    entry |= {"torque_constant": line.constant} if line.constant is not None else {}
    entry |= {"offset": line.offset} if line.offset else {}
    return entry | ({"plus": {"column": line.plus[0], "unit": line.plus[1]}} if line.plus is not None else {})


def text(proposal: Proposal) -> str:
    """Return the map file: a line per column with its reason; what decided units, what to check, what is unused."""
    entries = data(proposal)
    why = {line.target: f"{line.sure}: {line.why}" for line in proposal.lines}
    why |= {"motors": "measured: joint angle over motor angle at which the torques fit the model; power is conserved"}
    rows = [(f"{_flow(key)}: {_flow(value)}", why.get(key, "")) for key, value in entries.items()]
    width = min(max(len(row) for row, _ in rows), 70)
    lines = [f"# A map guessed from {proposal.file.name}. Look at it before it is used."]
    lines += [f"{row:<{width}}  # {reason}" if reason else row for row, reason in rows]
    lines += [f"# {row}" for row in proposal.rows]
    lines += [f"# look at: {doubt}" for doubt in proposal.doubts]
    lines += [f"# look at: torque_sensor: {proposal.sensor_doubt}"] if proposal.sensor_doubt else []
    unused = list(proposal.unused.items())
    lines += [f"# not used: {name} ({reason})" for name, reason in unused[:MOST_UNUSED]]
    if len(unused) > MOST_UNUSED:
        lines.append(f"# not used: {len(unused) - MOST_UNUSED} more columns")
    return "\n".join(lines) + "\n"


def advice(proposal: Proposal) -> list[str]:
    """Return sentences about what can be compared with this proposal, and what a stated controller would add."""
    signals, sensor = proposal.signals(), proposal.recording.get("torque_sensor", "none")
    torque = "tau" in signals and sensor != "none"
    servo = proposal.recording.get("control", {}).get("mode") == "servo"
    if servo:
        now = "as proposed, the goals drive each joint's own loop, whose speed, play, friction and zero can be compared"
    elif torque:
        now = "as proposed, motion and torque can be compared by inverse dynamics: friction, masses, torque offsets"
    else:
        why = "torque_sensor is not stated" if "tau" in signals else "there is no measured torque"
        now = f"as proposed, nothing can be compared: the controller is unknown and {why}"
    out = [now]
    gain = (
        "the model is then driven as the robot was, which also shows delays, gear play, elasticity and encoder errors"
    )
    if "q_cmd" in signals and not servo:
        n = len(proposal.joints)
        out.append(
            f"state the controller for more: control: {{mode: position, rate_hz: .., gravity_compensation: model, "
            f"kp: [{n} numbers, N m/rad], kd: [{n} numbers, N m s/rad]}} under `recording:`; {gain}"
        )
    elif "tau_cmd" in signals and not servo:
        out.append(
            "state the controller for more: control: {mode: torque, rate_hz: .., gravity_compensation: model or "
            f"none}} under `recording:`; {gain}"
        )
    elif not servo:
        out.append(f"commanded angles or torques in the log, and the controller's gains, would allow more: {gain}")
    if "tau" not in signals:
        out.append("measured torques would separate friction from load, and allow a comparison without the gains")
    return out


def _flow(value: Any) -> str:
    """Format a value as one line of YAML."""
    dumped = yaml.safe_dump(value, default_flow_style=True, allow_unicode=True, width=10_000, sort_keys=False)
    return dumped.strip().removesuffix("...").strip()
