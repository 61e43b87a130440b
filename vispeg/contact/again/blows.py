"""Impacts of a recorded tool: find them, and simulate each in worlds from a state just before it.

The energy lost in an impact shows within hundredths of a second, which a path band-limited to 40 Hz does not resolve.
So the whole arm is simulated under its recorded controller, from its state a few ms before contact. The impulse and the
time of flight until the next contact are compared, both counted from contact in the simulation or recording itself, so
that the height need not be known. Unlike the peak force, both are independent of the contact's stiffness.
Sources: window restarts as in Acosta, Yang and Posa 2022, Validating robotics simulators on real-world impacts, RA-L
7(3); restitution from the times between bounces, Bernstein 1977, Listening to the coefficient of restitution, American
Journal of Physics 45(1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vispeg.contact.torques import sensed
from vispeg.core.rules import RULES
from vispeg.recordings.differentiate import bridged
from vispeg.recordings.recording import Recording
from vispeg.recordings.regimes import FREE, IMPACT
from vispeg.robots.scene import Scene
from vispeg.sim.touch import Touch, touch
from vispeg.task.belief import recorded_cell
from vispeg.task.rig.run import run
from vispeg.worlds.world import World

BEFORE, AFTER = 0.012, 0.065  # s, simulated before and after the measured contact
CALM = 0.05  # s of free air before contact from which position and speed are estimated
HIT = 0.016  # s after first contact for peak and impulse; longer if the tool separates later


@dataclass(frozen=True)
class Blow:
    """One impact.

    Attributes:
        recording: recording that contains it.
        scene: the believed cell.
        rows: rows of the recording that are simulated, from `BEFORE` the measured contact to `AFTER` it.
        start: (nj,) rad and rad/s, measured joint angles and speeds at the first of these rows.
        axis: (3,) direction of the contact force, flange axes; a unit vector.
        threshold: contact force that counts as contact, N.
        speed: speed of the tip at the first of these rows, m/s.
        felt: (2,) measured impulse along the axis, N s, and time of flight, s.
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
        """Expected errors (2,) of impulse and flight with a correct model, N s and s."""
        ends = 2 / self.recording.rate_hz  # s: a flight begins and ends between two samples each
        impulse, flight = RULES.blow_least
        return np.hypot([impulse, max(flight, ends)], np.array(RULES.blow_form) * self.felt)


def restarts(rec: Recording) -> bool:
    """Return whether a recording has a wrench and a controller with which parts of it can be simulated.

    Its rows must come at the controller's rate, because each one is a command of the simulation.
    """
    if rec.control.mode != "osc" or rec.ee_cmd is None or not sensed(rec):
        return False
    clock = np.diff(rec.time) * rec.control.rate_hz
    return bool(abs(np.median(clock) - 1) < 0.05)


def blows(rec: Recording, contact: Touch | None = None) -> list[Blow]:
    """Return the impacts of a recording, except those after a rebound; empty if `restarts` says no.

    `contact` is the contact along the recording, if it is known already.
    """
    if not restarts(rec):
        return []
    cell = recorded_cell(rec)
    contact = contact or touch(rec, cell.scene)
    assert contact is not None  # `restarts` says that there is a wrench
    hit = contact.regime == IMPACT
    calm, before, after = (round(s * rec.rate_hz) for s in (CALM, BEFORE, AFTER))
    out = []
    for start in np.flatnonzero(hit & ~np.r_[False, hit[:-1]]):
        first = int(start) + int(np.argmax(contact.force[start : start + after] > contact.threshold))
        if first < calm + before or first + after >= len(rec.time):
            continue
        if np.any(contact.regime[first - calm : start] != FREE):
            continue
        if rec.episode is not None and rec.episode[first - calm] != rec.episode[first + after]:
            continue
        rows = slice(first - before, first + after)
        push = contact.wrench[first : first + after, :3] - contact.wrench[first - before : first, :3].mean(axis=0)
        axis = push.sum(axis=0) / max(np.linalg.norm(push.sum(axis=0)), 1e-9)
        speed = float(np.linalg.norm(contact.velocity[first - before]))
        measured = _felt(contact.wrench[rows, :3] @ axis, rec.rate_hz, before, contact.threshold)
        if np.isfinite(measured).all():
            begin = _started(rec, first - calm, first, first - before)
            out.append(Blow(rec, cell.scene, rows, begin, axis, contact.threshold, speed, measured))
    return out


def predicted(blow: Blow, worlds: Sequence[World], nthread: int = 1) -> np.ndarray:
    """Return the predicted impulse and flight, (nworld, 2) N s and s; NaN for a world without contact in time."""
    rec, rate = blow.recording, blow.recording.control.rate_hz
    assert rec.ee_cmd is not None
    cell = recorded_cell(rec)
    plants = [cell.world.add(*w.effects) for w in worlds]
    begun = float(rec.elapsed[blow.rows.start])
    ran = run(cell.scene, plants, rec.control, rec.ee_cmd[blow.rows], *blow.start, begun=begun, nthread=nthread).ft
    before = max(2, round(0.5 * BEFORE * rate))  # only half: a simulated contact may come earlier
    return np.stack([_felt(wrench @ blow.axis, rate, before, blow.threshold) for wrench in ran[:, :, :3]])


def _felt(force: np.ndarray, rate: float, before: int, threshold: float) -> np.ndarray:
    """Return impulse, N s, and flight, s, of a force along its axis; NaN without an impact.

    A tool that does not touch again counts as flying until the end of `force`; one that does not separate within twice
    `HIT` does not fly.

    Args:
        force: (n,) N.
        rate: of its samples, Hz.
        before: number of samples at its start that are surely free of contact; their mean is its zero.
        threshold: force that counts as contact, N.
    """
    above, hit = force - force[:before].mean(), round(HIT * rate)
    touched = np.flatnonzero(np.abs(above) > threshold)
    begin = int(touched[0]) if len(touched) else 0
    peak = above[begin : begin + hit].max() if len(touched) else 0.0
    if peak < RULES.blow_brush * threshold or begin + hit > len(above):
        return np.full(2, np.nan)
    on = above > max(threshold, RULES.blow_parted * peak)
    first = int(np.argmax(on))
    leaves = first + int(np.argmin(np.r_[on[first:], False]))
    flies = leaves < first + 2 * hit
    flight = int(np.argmax(np.r_[on[leaves:], True])) if flies else 0
    end = max(begin + hit, leaves) if flies else begin + hit
    return np.array([above[begin:end].sum() / rate, flight / rate])


def _started(rec: Recording, begin: int, end: int, at: int) -> tuple[np.ndarray, np.ndarray]:
    """Return angles (nj,) rad and rates (nj,) rad/s at row `at` of a parabola fitted to the rows `begin` to `end`."""
    time = rec.time[begin:end] - rec.time[at]
    curve = np.polynomial.polynomial.polyfit(time, bridged(rec.time, rec.q, rec.episode)[begin:end], 2)
    return curve[0], curve[1]
