"""Noise floor of each phase: the residual of the correct model, from simulated repeats.

Simulating the nominal hand gives a path and a wrench that agree exactly. The simulation is repeated with the
recording's noise added to both, and the resulting correction is noise, not model error. Two terms are added to it:
`floor_form`, the effect of another integrator and contact law on the correct model, and a share of a contact's chatter,
since impacts that the path does not show push one way on average. Further errors of the sensor are in
`vispeg.contact.errors.nuisance`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from vispeg.contact.drive import Driven, drive
from vispeg.contact.errors.noise import noise
from vispeg.contact.hand import UNITS
from vispeg.contact.inputs import ContactItem
from vispeg.contact.path import PATH_HZ, Path
from vispeg.contact.phases import NAMES
from vispeg.contact.sensor import REACH, hand_world, true_wrench
from vispeg.core.rules import RULES
from vispeg.core.seeds import stream
from vispeg.recordings.differentiate import smooth
from vispeg.recordings.noise import noise_of
from vispeg.recordings.regimes import INSIDE, REGIMES
from vispeg.worlds.world import World


def floors(item: ContactItem, once: Driven, nthread: int) -> np.ndarray:
    """Return the expected RMS residual of a correct model in each block, (m, 6) N and N m.

    `once` is the result of driving the nominal model along the path.
    """
    path, phase, rec = item.path, item.phase, item.recording
    world = hand_world(item.source.believed, World())
    wrench = true_wrench(path, world)[None]
    rng = stream(0, "contact floor")
    place, rate = _noisy(once.place[0], path.time, path.clock, float(np.mean(noise_of(rec)["q"])) * REACH, rng)
    read = wrench[0] - once.zero + np.nan_to_num(once.correction[0])
    sigma = noise(item)
    read = read + _on_steps(sigma * rng.standard_normal((len(path.clock), 6)), path)
    again = replace(path, place=place, rate=rate)
    residual = phase.means(
        drive(
            item.armless, item.source.scene, again, [world], read[None], phase.rest, phase.windows, nthread
        ).correction
    )[0]
    out = np.empty_like(residual)
    tilt, near_slide = tilted(item), np.convolve(phase.of("slide"), np.ones(2 * RULES.floor_loose + 1), "same") > 0
    forms: dict[str, float] = dict(zip(NAMES, RULES.floor_form, strict=True))
    shares: dict[str, float] = dict(zip(NAMES, RULES.floor_share, strict=True))
    for name in NAMES:
        rows, used = phase.of(name), phase.of(name) & phase.valid & ~phase.resting
        if rows.any():
            rms = np.sqrt(np.mean(residual[used] ** 2, axis=0)) if used.any() else 0.0
            # blocks near a slide have its error of form, for no model says when exactly a contact breaks loose
            for blocks, law in ((rows & ~near_slide, name), (rows & near_slide, name if name == "impact" else "slide")):
                wedge = RULES.floor_wedged if law == REGIMES[INSIDE] else 0.0
                share = shares[law] + wedge * tilt[blocks] ** 2
                form = np.hypot(forms[law], share * phase.force[blocks])
                out[blocks] = np.hypot(rms, form[:, None] * UNITS)
    chatter = np.sqrt(np.maximum(phase.scatter(path.wrench) ** 2 - sigma**2, 0.0))
    out = np.hypot(out, chatter / np.sqrt(phase.size))
    out[phase.resting] = RULES.zero * UNITS
    return out


def tilted(item: ContactItem) -> np.ndarray:
    """Return the sine of the hand's tilt against the goal's axis (the base's z), (m,)."""
    path = item.path
    turn = Rotation.from_quat(path.frame, scalar_first=True)
    axis = (turn * Rotation.from_euler("XYZ", path.place[item.phase.rows(path.time), 3:])).apply([0.0, 0.0, 1.0])
    return np.hypot(axis[:, 0], axis[:, 1])


def _noisy(place: np.ndarray, time: np.ndarray, clock: np.ndarray, sigma: float, rng) -> tuple[np.ndarray, np.ndarray]:
    """Return a path (n, 6) at the steps `time`, and its rate, as measured at times `clock` with noise `sigma`."""
    sampled = np.stack([np.interp(clock, time, p) for p in place.T], axis=1)
    calm, rate, _ = smooth(clock, sampled + sigma * rng.standard_normal(sampled.shape), PATH_HZ)
    grid = [np.stack([np.interp(time, clock, v) for v in values.T], axis=1) for values in (calm, rate)]
    return grid[0], grid[1]


def _on_steps(values: np.ndarray, path: Path) -> np.ndarray:
    """Resample readings (len(path.clock), k) to the steps of a path, (n, k); the noise of block means stays."""
    return np.stack([np.interp(path.time, path.clock, v) for v in values.T], axis=1)
