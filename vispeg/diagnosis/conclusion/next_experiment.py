"""Choose the next motion to record, if something is left to find out.

If several effects explain the recordings equally well, it is the motion in which the two best explanations A and B
differ most (T-optimal design): of a menu of motions the one with the largest `sqrt(sum(((y_A - y_B) / sigma)^2))`, the
distance of their predictions in standard deviations of the noise (Atkinson and Fedorov, Biometrika 62(1), 1975). Below
`next_sigma` no motion is proposed, since noise would hide the difference. If the verdict is `unexplained`, it is a
motion that separates effects of speed, load and reversals. A motion already recorded is not proposed again while
another would do. If the model is adequate, or identified without rivals, nothing is proposed.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from vispeg.core.rules import RULES
from vispeg.core.seeds import stream
from vispeg.diagnosis.findings import Rivals
from vispeg.diagnosis.schema import NextMotion
from vispeg.diagnosis.selection.searching import Searching
from vispeg.diagnosis.selection.state import State
from vispeg.identify.excitation import motion
from vispeg.identify.inverse import TorqueEvidence
from vispeg.identify.record import controller
from vispeg.recordings.recording import Recording
from vispeg.sim.rollout import simulate
from vispeg.sim.segments.segment import Segment
from vispeg.worlds.world import World

SHOWS = {  # the menu, in the order in which it is proposed if the verdict is `unexplained`, and what each motion shows
    "triangle": "shows speed, reversal and load regimes apart, each joint alone",
    "sweep": "shows each joint over its whole reach, the others still",
    "chirp": "shows speed and frequency apart, up to what the joints' limits allow",
    "steps": "shows rest, breaking loose and small moves",
    "fourier": "is another trajectory, on which what is left may repeat or not",
}
MENU = tuple(SHOWS)
SECONDS = 6.0  # of each motion


def next_experiment(
    search: Searching, state: State, rivals: Sequence[Rivals], verdict: str, seed: int, recorded: Collection[str] = ()
) -> tuple[NextMotion | None, dict[str, np.ndarray]]:
    """Return the record's `next_experiment` and the arrays of its picture, or None and none if nothing is left to find.

    The motion's name is empty if none of the menu helps.

    Args:
        search: the finished search.
        state: its last state.
        rivals: of the effects that it added.
        verdict: of the diagnosis.
        seed: of the motions' random parts.
        recorded: names of the motions already recorded, if known.

    Returns:
        The entry, and `next/time` (n,) s, `next/q_cmd` and `next/dq_cmd` (n, nj) rad, rad/s; with rivals also their
        predictions `next/A` and `next/B` (n, nj), rad or N m.
    """
    pair = _explanations(state, rivals)
    if pair is None and verdict != "unexplained":
        return None, {}
    menu = _Menu(search, seed) if search.evidence.unit == "rad" else _TorqueMenu(search, seed)
    if pair is None:
        name = next((name for name in SHOWS if name not in recorded), "")
        if not name:
            why = "every motion of the menu is recorded: record another arm posture or another speed of one of them"
            return {"motion": "", "why": why}, {}
        return menu.record(name, SHOWS[name] + menu.advice), menu.arrays(name)
    first, second, names = pair
    apart = menu.apart(first, second)
    fresh = {n: rows for n, rows in apart.items() if n not in recorded and rows[0] >= RULES.next_sigma}
    name = max(fresh or apart, key=lambda n: apart[n][0])
    sigma, a, b = apart[name]
    if sigma < RULES.next_sigma:
        best = f"(the best, {name}, by {sigma:.2g})"
        why = f"no motion of the menu separates {names[0]} from {names[1]} by {RULES.next_sigma:g} sigma {best}"
        return {"motion": "", "why": why, "expected_separation_sigma": round(sigma, 2)}, {}
    proposed = menu.record(name, f"separates {names[0]} from {names[1]}")
    proposed["expected_separation_sigma"] = round(sigma, 2)
    return proposed, menu.arrays(name) | {"next/A": a, "next/B": b}


def repeated(name: str) -> NextMotion:
    """Return the advice if the recording `name` is the only one that shows what a model lacks."""
    why = f"only {name} shows what the model lacks: record a second motion like it, a little faster or slower"
    return {"motion": "", "why": why}


class _Menu:
    """The menu of motions for the recorded robot, under its position controller, or one made for it if it has another.

    Noise and joints are those of the first recording.
    """

    advice = ""  # added to the purpose of a motion if the verdict is `unexplained`

    def __init__(self, search: Searching, seed: int):
        self.evidence, self.seed = search.evidence, seed
        self.item = search.evidence.items[0]
        control = self.item.segment.control
        if control.mode not in ("position", "servo"):
            control = controller(self.item.robot, "position", control.rate_hz, self.item.segment.q[0])
        self.control = control
        self.motions = {
            name: motion(name, self.item.robot, control.rate_hz, SECONDS, stream(seed, "next experiment", name))
            for name in MENU
        }

    def apart(self, a: World, b: World) -> dict[str, tuple[float, np.ndarray, np.ndarray]]:
        """Return for each motion the distance of two worlds' predictions in sigma, and both predictions (n, nj) rad.

        The distance is 0 if a rollout diverges.
        """
        segments = [
            Segment(
                self.control, 1.0 / self.control.rate_hz, {"q_cmd": m.q_cmd, "dq_cmd": m.dq_cmd},
                q=m.q_cmd, dq=m.dq_cmd, q_raw=m.q_cmd, time=m.time, rows=np.arange(len(m.time)),
            )
            for m in self.motions.values()
        ]  # fmt: skip
        out = {}
        h_max, nthread = self.evidence.step_of(self.control.mode, a, b), self.evidence.nthread
        responses = simulate(self.item.robot, [a, b], segments, h_max=h_max, nthread=nthread)
        for name, response in zip(self.motions, responses, strict=True):
            gap = (response.q[0] - response.q[1]) / self.item.sigma[: self.item.nj]
            sigma = float(np.sqrt(np.sum(gap**2))) if np.isfinite(gap).all() else 0.0
            out[name] = sigma, response.q[0], response.q[1]
        return out

    def record(self, name: str, why: str) -> NextMotion:
        """Return the `next_experiment` that proposes a motion; its `file` is relative to the record's folder."""
        return {
            "motion": name,
            "why": why,
            "seed": self.seed,
            "duration_s": SECONDS,
            "rate_hz": self.control.rate_hz,
            "file": "next_experiment/samples.csv",
        }

    def arrays(self, name: str) -> dict[str, np.ndarray]:
        """Return the commanded motion as arrays."""
        m = self.motions[name]
        return {"next/time": m.time, "next/q_cmd": m.q_cmd, "next/dq_cmd": m.dq_cmd}


class _TorqueMenu(_Menu):
    """The menu for torque comparison: the torque that each motion needs, taken as executed under any controller."""

    advice = "; with the controller's mode and gains stated, rollouts can show delays, gear play and encoders too"

    def apart(self, a: World, b: World) -> dict[str, tuple[float, np.ndarray, np.ndarray]]:
        """Return for each motion the distance of two worlds' torques in sigma, and both torques (n, nj) N m."""
        out, like = {}, self.item.recording
        for name, m in self.motions.items():
            rec = Recording(
                like.path, like.robot, like.joints, self.control.rate_hz, like.control, m.time, m.q_cmd,
                tau=np.zeros_like(m.q_cmd), tool=like.tool, base_tilt=like.base_tilt,
                torque_sensor=like.torque_sensor, noise=like.noise,
            )  # fmt: skip
            evidence = TorqueEvidence([rec])
            (y,) = evidence.simulated([a, b])
            gap = ((y[0] - y[1]) / self.item.sigma[: self.item.nj])[evidence.items[0].valid.any(axis=1)]
            at = evidence.items[0].segment.time  # fewer samples than the motion has
            first, second = (np.stack([np.interp(m.time, at, c) for c in torque.T], axis=1) for torque in y)
            out[name] = float(np.sqrt(np.sum(gap**2))), first, second
        return out


def _explanations(state: State, rivals: Sequence[Rivals]) -> tuple[World, World, tuple[str, str]] | None:
    """Return the worlds to tell apart, the final one and the best with a rival, and the labels of effect and rival.

    None if no effect has an equal rival.
    """
    pairs = [(t, r.label) for r in rivals for t in r.equals]
    if not pairs:
        return None
    rival, label = min(pairs, key=lambda p: float(p[0].loss.sum()))
    return state.world, rival.fit.world, (label, rival.score.placed.label)
