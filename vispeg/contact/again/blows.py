"""Blows of a recorded tool: found, and run again in worlds from just before each, as restarts of a toss are.

What a contact takes out of a blow shows in its first hundredths of a second, which no path at 40 Hz holds. So the
whole arm runs again, under the controller that ran, from where it was some ms before the touch. Compared are the
impulse, and how long the tool then flies until it touches again, each from its own touch on, so that a height need not
be known. Both are the same of a stiff and of a soft contact; a force is not. Sources: window restarts as in Acosta,
Yang and Posa 2022, Validating robotics simulators on real-world impacts, RA-L 7(3); restitution from the times between
bounces, Bernstein 1977, Listening to the coefficient of restitution, American Journal of Physics 45(1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vispeg.contact.torques import sensed
from vispeg.core.rules import RULES
from vispeg.recordings.cell import wrench_noise
from vispeg.recordings.recording import Recording
from vispeg.recordings.regimes import FREE, IMPACT
from vispeg.robots.scene import Scene
from vispeg.sim.touch import Touch, touch
from vispeg.task.belief import recorded_cell
from vispeg.task.rig.run import run
from vispeg.worlds.world import World

BEFORE, AFTER = 0.012, 0.065  # s that are run before the measured touch, and after it
CALM = 0.05  # s before the touch in free air from which place and speed are taken
HIT = 0.016  # s from the touch, in which the peak and the impulse are, or until a tool parts later than that


@dataclass(frozen=True)
class Blow:
    """One touch at some speed.

    Attributes:
        recording: that it is in.
        scene: the believed cell.
        rows: of the recording, that are run again.
        start: (nj,) rad, rad/s, where the arm was at the first of these rows and how fast, as read.
        axis: (3,) along which the contact pushes, flange axes.
        threshold: N, of a touch.
        speed: m/s, of the tip.
        felt: (2,) impulse, N s along the axis, and flight, s.
    """

    recording: Recording
    scene: Scene
    rows: slice
    start: tuple[np.ndarray, np.ndarray]
    axis: np.ndarray
    threshold: float
    speed: float
    felt: np.ndarray

    @property
    def sigma(self) -> np.ndarray:
        """(2,) N s and s, what the right model leaves."""
        return np.hypot(
            [RULES.blow_impulse_least, max(RULES.blow_flight_least, 2 / self.recording.rate_hz)],
            np.array([RULES.blow_impulse, RULES.blow_flight]) * self.felt,
        )


def restarts(rec: Recording) -> bool:
    """Whether a recording has a wrench and a controller under which stretches of it can run again."""
    if rec.control.mode != "osc" or rec.ee_cmd is None or not sensed(rec):
        return False
    clock = np.diff(rec.time) * rec.control.rate_hz
    return bool(abs(np.median(clock) - 1) < 0.05)


def blows(rec: Recording, felt: Touch | None = None) -> list[Blow]:
    """Those of a recording that `restarts`; a rebound's own touch is no blow. `felt`: what it touched, if known."""
    if not restarts(rec):
        return []
    cell = recorded_cell(rec)
    felt = felt or touch(rec, cell.scene)
    assert felt is not None
    hit = felt.regime == IMPACT
    calm, before, after = (round(s * rec.rate_hz) for s in (CALM, BEFORE, AFTER))
    noise = wrench_noise(rec.noise)
    out = []
    for start in np.flatnonzero(hit & ~np.r_[False, hit[:-1]]):
        first = int(start) + int(np.argmax(felt.force[start : start + after] > felt.threshold))
        if first < calm + before or first + after >= len(rec.time) or np.any(felt.regime[first - calm : start] != FREE):
            continue
        if rec.episode is not None and rec.episode[first - calm] != rec.episode[first + after]:
            continue
        rows = slice(first - before, first + after)
        push = felt.wrench[first : first + after, :3] - felt.wrench[first - before : first, :3].mean(axis=0)
        axis = push.sum(axis=0) / max(np.linalg.norm(push.sum(axis=0)), 1e-9)
        speed = float(np.linalg.norm(felt.velocity[first - before]))
        least = max(felt.threshold, 0.0 if noise is None else RULES.blow_noise * float(noise[0]))
        blow = _felt(felt.wrench[rows, :3] @ axis, rec.rate_hz, before, least)
        if np.isfinite(blow).all():
            begin = _started(rec, first - calm, first, first - before)
            out.append(Blow(rec, cell.scene, rows, begin, axis, least, speed, blow))
    return out


def predicted(blow: Blow, worlds: Sequence[World], nthread: int = 1) -> np.ndarray:
    """(nworld, 2) N s and s that the worlds predict for a blow; NaN where a world does not hit in time."""
    rec, rate = blow.recording, blow.recording.control.rate_hz
    assert rec.ee_cmd is not None
    cell = recorded_cell(rec)
    plants = [cell.world.add(*w.effects) for w in worlds]
    ran = run(cell.scene, plants, rec.control, rec.ee_cmd[blow.rows], *blow.start, nthread=nthread).ft
    before = max(2, round(0.5 * BEFORE * rate))
    return np.stack([_felt(wrench @ blow.axis, rate, before, blow.threshold) for wrench in ran[:, :, :3]])


def _felt(force: np.ndarray, rate: float, before: int, threshold: float) -> np.ndarray:
    """(2,) impulse and flight of a force (n,) less what it was `before` the touch; NaN without a blow.

    A tool that does not come back is said to fly until the force's end.
    """
    above, hit = force - force[:before].mean(), round(HIT * rate)
    touched = np.flatnonzero(np.abs(above) > threshold)
    peak = above[touched[0] : touched[0] + hit].max() if len(touched) else 0.0
    if peak < RULES.blow_brush * threshold or touched[0] + hit > len(above):
        return np.full(2, np.nan)
    on = above > max(threshold, RULES.blow_parted * peak)
    first = int(np.argmax(on))
    part = first + int(np.argmin(np.r_[on[first:], False]))
    flight = int(np.argmax(np.r_[on[part:], True]))
    parts = part < first + 2 * hit  # or else it stays
    end = max(touched[0] + hit, part) if parts else touched[0] + hit
    return np.array([above[touched[0] : end].sum() / rate, parts * flight / rate])


def _started(rec: Recording, begin: int, end: int, at: int) -> tuple[np.ndarray, np.ndarray]:
    """Angles and rates (nj,) at row `at` of a parabola through the rows between, in which nothing is touched."""
    time = rec.time[begin:end] - rec.time[at]
    curve = np.polynomial.polynomial.polyfit(time, np.nan_to_num(rec.q[begin:end]), 2)
    return curve[0], curve[1]
