"""Logs of an arm of seven joints in the styles of several robots and tools, and the signals to be found in them."""

import gzip

import numpy as np

JOINTS = tuple(f"joint{i}" for i in range(1, 8))
N = 400
TIME = 0.002 * np.arange(N)
Q = np.stack([0.6 * np.sin(2 * np.pi * (0.6 + 0.1 * j) * TIME + j) - 1.1 * (j == 3) for j in range(7)], 1)
DQ = np.gradient(Q, TIME, axis=0)
TAU = 5.0 * np.cos(3 * TIME[:, None] + np.arange(7))
ALPHABETICAL = (2, 5, 0, 1, 3, 4, 6)


def numbered(pattern, values, first=0, order=range(7)):
    return {pattern.format(k + first): values[:, j] for k, j in enumerate(order)}


STYLES = {  # style -> (columns, signals that an import must find)
    "own words": (
        {"t_ms": 1e3 * TIME} | numbered("pos_{} [deg]", np.degrees(Q), 1) | numbered("load_{}_mNm", 1e3 * TAU, 1),
        ("q", "tau"),
    ),
    "degrees, and speeds in rad/s": (
        {"t_ms": 1e3 * TIME}
        | numbered("pos_{}_deg", np.degrees(Q))
        | numbered("vel_{}", DQ)
        | numbered("goal_{}_deg", np.degrees(Q + 0.01))
        | numbered("goalvel_{}", DQ),
        ("q", "dq", "q_cmd"),
    ),
    "radians, and speeds in deg/s": (
        {"stamp": 1e3 * TIME} | numbered("q_{}", Q) | numbered("qd_{}", np.degrees(DQ)),
        ("q", "dq"),
    ),
    "franka": (
        {"time": 1e3 * TIME}
        | numbered("q_{}", Q)
        | numbered("q_d_{}", Q + 0.01)
        | numbered("dq_{}", DQ)
        | numbered("dq_d_{}", DQ)
        | numbered("tau_J_{}", TAU)
        | numbered("tau_J_d_{}", TAU)
        | numbered("tau_ext_hat_filtered_{}", 9 * TAU)
        | numbered("ddq_d_{}", TAU)
        | numbered("theta_{}", Q + 3),
        ("q", "dq", "tau", "tau_cmd", "q_cmd", "dq_cmd"),
    ),
    "franka, brackets": (
        {"robot_state.time": TIME} | numbered("q[{}]", Q) | numbered("dq[{}]", DQ) | numbered("tau_J[{}]", TAU),
        ("q", "dq", "tau"),
    ),
    "universal robots": (
        {"timestamp": 5e5 + TIME}
        | numbered("target_q_{}", Q + 0.01)
        | numbered("actual_q_{}", Q)
        | numbered("target_qd_{}", DQ)
        | numbered("actual_qd_{}", DQ)
        | numbered("actual_current_{}", 8 * TAU),
        ("q", "dq", "q_cmd", "dq_cmd"),
    ),
    "kuka rsi": (
        {"Timestamp [us]": 1e6 * TIME}
        | numbered("AIPos.A{}", np.degrees(Q), 1)
        | numbered("ASPos.A{}", np.degrees(Q + 0.01), 1)
        | numbered("MACur.A{}", TAU, 1),
        ("q", "q_cmd"),
    ),
    "joint states echoed": (
        {"%time": 1.7e18 + 1e9 * TIME, "field.header.seq": np.arange(N), "field.header.stamp": 1.7e18 + 1e9 * TIME}
        | {f"field.name{k}": [JOINTS[j]] * N for k, j in enumerate(ALPHABETICAL)}
        | numbered("field.position{}", Q, 0, ALPHABETICAL)
        | numbered("field.velocity{}", DQ, 0, ALPHABETICAL)
        | numbered("field.effort{}", TAU, 0, ALPHABETICAL),
        ("q", "dq", "tau"),
    ),
    "plotjuggler": (
        {"__time": 1.7e9 + TIME}
        | {f"/joint_states/{JOINTS[j]}/position": Q[:, j] for j in ALPHABETICAL}
        | {f"/joint_states/{JOINTS[j]}/velocity": DQ[:, j] for j in ALPHABETICAL},
        ("q", "dq"),
    ),
    "lerobot": (
        {"timestamp": TIME, "frame_index": np.arange(N), "episode_index": np.zeros(N), "index": np.arange(N)}
        | {f"observation.state.{j}.pos": np.degrees(Q[:, k]) for k, j in enumerate(JOINTS)}
        | {f"action.{j}.pos": np.degrees(Q[:, k]) + 0.5 for k, j in enumerate(JOINTS)},
        ("q", "q_cmd"),
    ),
    "german": (
        {"Zeit [ms]": 1e3 * TIME}
        | numbered("Winkel A{} [Grad]", np.degrees(Q), 1)
        | numbered("Drehmoment A{} [Nm]", TAU, 1),
        ("q", "tau"),
    ),
    "no units, degrees": (
        {"Time": TIME} | numbered("J{}", np.zeros_like(Q), 1) | numbered("J{} angle", np.degrees(Q), 1),
        ("q",),
    ),
}
TRUTH = {"q": Q, "dq": DQ, "tau": TAU, "tau_cmd": TAU, "q_cmd": Q + 0.01, "dq_cmd": DQ}


def write_table(file, columns, separator=",", decimal="."):
    rows = [separator.join(columns)]
    for row in zip(*columns.values(), strict=True):
        rows.append(separator.join(str(x) if isinstance(x, str) else repr(float(x)).replace(".", decimal) for x in row))
    data = ("\n".join(rows) + "\n").encode()
    file.write_bytes(gzip.compress(data) if file.suffix == ".gz" else data)
    return file
