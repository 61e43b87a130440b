"""The next motion to record: the one on which the leading explanations would differ most (T-optimal design).

Over a menu of motions, maximise `sqrt(sum ((y_A - y_B) / sigma)^2)`, the distance in sigma between the predictions
of the two best explanations (Atkinson and Fedorov, Biometrika 62(1), 1975).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vispeg.core.seeds import stream
from vispeg.core.world import World
from vispeg.diagnose.rivals import Rivals
from vispeg.diagnose.search import Search
from vispeg.diagnose.state import State
from vispeg.identify.excitation import motion
from vispeg.identify.record import controller
from vispeg.sim.rollout import simulate
from vispeg.sim.segment import Segment

MENU = ("triangle", "chirp", "steps", "fourier", "sweep")
SECONDS = 6.0


def next_experiment(
    search: Search, state: State, given: int, rivals: Sequence[Rivals], verdict: str, seed: int
) -> tuple[dict | None, dict[str, np.ndarray]]:
    """The record's `next_experiment` and the arrays of its picture; None where nothing is left to tell apart."""
    a, b, names = _explanations(state, rivals, verdict)
    if a is None or b is None or search.evidence.unit != "rad":
        return _by_hand(search, verdict), {}
    item = search.evidence.items[0]
    control = item.segment.control
    if control.mode != "position":
        control = controller(item.robot, "position", control.rate_hz, item.segment.q[0])
    best: tuple[float, dict, dict[str, np.ndarray]] = (-1.0, {}, {})
    motions = [
        motion(name, item.robot, control.rate_hz, SECONDS, stream(seed, "next experiment", name)) for name in MENU
    ]
    menu = [
        Segment(
            control, 1.0 / control.rate_hz, {"q_cmd": m.q_cmd, "dq_cmd": m.dq_cmd}, m.q_cmd, m.dq_cmd, m.q_cmd, m.time,
            np.arange(len(m.time)),
        )
        for m in motions
    ]  # fmt: skip
    responses = simulate(item.robot, [a, b], menu, h_max=search.evidence.h_max, nthread=search.evidence.nthread)
    for name, m, response in zip(MENU, motions, responses, strict=True):
        y = response.q
        gap = (y[0] - y[1]) / item.sigma[: item.nj]
        sigma = float(np.sqrt(np.nansum(gap**2)))
        if np.isfinite(gap).all() and sigma > best[0]:
            why = f"separates {names[0]} from {names[1]}"
            record = {
                "motion": name,
                "why": why,
                "expected_separation_sigma": round(sigma, 2),
                "seed": seed,
                "duration_s": SECONDS,
                "rate_hz": control.rate_hz,
                "file": "next_experiment/samples.csv",
            }
            arrays = {
                "next/time": m.time,
                "next/q_cmd": m.q_cmd,
                "next/dq_cmd": m.dq_cmd,
                "next/A": y[0],
                "next/B": y[1],
            }
            best = (sigma, record, arrays)
    return (best[1], best[2]) if best[0] >= 0 else (_by_hand(search, verdict), {})


def _explanations(
    state: State, rivals: Sequence[Rivals], verdict: str
) -> tuple[World | None, World | None, tuple[str, str]]:
    """The two worlds to tell apart: the final one and its closest rival, equal or not."""
    pairs = [(t, r.label) for r in rivals for t in (r.equals or r.tried)]
    if verdict == "adequate" or not pairs:
        return None, None, ("", "")
    rival, label = min(pairs, key=lambda p: float(p[0].loss.sum()))
    return state.world, rival.fit.world, (label, rival.score.placed.label)


def _by_hand(search: Search, verdict: str) -> dict | None:
    if verdict == "adequate":
        return None
    why = "shows speed, reversal and load regimes apart, each joint alone"
    if search.evidence.unit != "rad":
        why = "a known controller (position mode, gains stated) lets rollouts decide what inverse dynamics cannot"
    return {"motion": "triangle", "why": why, "expected_separation_sigma": 0.0}
