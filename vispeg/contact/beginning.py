"""Start of a contact recording: at rest in free air, where the wrench is the tool's weight plus the sensor's zero.

`check`, `compare` and `diagnose` use the same function to decide whether a wrench is plausible.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from vispeg.contact.inputs import Touching
from vispeg.contact.path import Path, along
from vispeg.contact.phases import Phases, phases, tool_mass
from vispeg.core.errors import UserError
from vispeg.core.rules import RULES
from vispeg.recordings.recording import Recording
from vispeg.recordings.regimes import Thresholds
from vispeg.robots.scene import Scene
from vispeg.sim.touch import Touch

H_MAX = 1e-3  # s, largest physics step: at twice this, sliding friction drops by 10 %
TOUCH = Thresholds().touch  # N: no smaller force counts as contact, nor does a lighter tool's weight here
MILLI = 1e3  # newtons to millinewtons: no arm presses with a thousand times its tool's weight


def beginnings(t: Touching, felt: Touch) -> list[tuple[Path, Phases]]:
    """Return path and phases of each episode that begins in free air.

    Raises:
        UserError: there is none, or the wrench there is not the tool's weight.
    """
    paths = _paths(t, felt)
    _refuse_foreign(t, paths)
    begun = [(path, phase) for path, phase in paths if phase is not None]
    if not begun:
        raise no_free_air(t)
    return begun


def refuse_foreign(t: Touching, felt: Touch) -> None:
    """Raise UserError for a wrench that contradicts the recording's `wrench` entry, as `beginnings` does.

    A recording that begins in contact passes: it cannot be compared by its wrench, but the entry is not contradicted.
    """
    _refuse_foreign(t, _paths(t, felt))


def episode_numbers(rec: Recording) -> np.ndarray:
    """Return the episode of each sample, (n,) int."""
    return np.zeros(len(rec.time), int) if rec.episode is None else rec.episode


def tared(rec: Recording) -> bool:
    """Return whether the tool's weight at the start was subtracted with the sensor's zero."""
    return rec.wrench is not None and rec.wrench.tared is True


def no_free_air(t: Touching) -> UserError:
    """Return the error for a recording in which every episode begins in contact."""
    return UserError(
        "no episode begins in free air",
        file=t.recording.path,
        expected="0.3 s or more at rest, then a move that leaves the force as it is, before the first contact",
        got="a force that changes with the move, by 2 N a mm or more, or no rest",
    )


def _paths(t: Touching, felt: Touch) -> list[tuple[Path, Phases | None]]:
    """Return each episode's path, with its phases if it begins in free air."""
    number = episode_numbers(t.recording)
    episodes = [np.flatnonzero(number == n) for n in np.unique(number)]
    paths = [along(t.scene, t.recording, t.wrench, rows, H_MAX, t.believed) for rows in episodes]
    return [(path, phases(felt, path, t.scene, RULES.contact_block)) for path in paths]


def _refuse_foreign(t: Touching, paths: Sequence[tuple[Path, Phases | None]]) -> None:
    """Raise UserError if the wrench differs from the tool's weight by more than errors of mass or zero explain.

    The wrench is read at rest in free air. If no episode seems to begin there, the wrench may be in millinewtons, so
    that noise looks like contact: then the readings at the start are a thousand times the weight.
    """
    if t.torques is not None:
        return
    begun = next(((path, phase.rest) for path, phase in paths if phase is not None), None)
    path, rest = begun or (paths[0][0], slice(0, max(1, round(RULES.rest_least / paths[0][0].step))))
    reads, weight = path.wrench[rest, :3].mean(axis=0), _weight(t.scene, path, rest)
    size, wanted = np.linalg.norm(reads), np.linalg.norm(weight)
    says = f"about the tool's weight, {_newtons(weight)} N (flange x, y, z)"
    if tared(t.recording):
        foreign, says = begun is not None and size > RULES.weight_times * TOUCH, "nothing"
    elif begun is not None:
        towards = float(reads @ weight) >= RULES.weight_towards * size * wanted
        foreign = wanted > TOUCH and not (towards and wanted / RULES.weight_times < size < RULES.weight_times * wanted)
    else:
        foreign = wanted > TOUCH and wanted / RULES.weight_times < size / MILLI < RULES.weight_times * wanted
    if foreign:
        raise UserError(
            "`ft` at rest in free air is not what the tool weighs",
            file=t.recording.path,
            expected=f"{says}: sign, unit, frame and tare as `wrench` says",
            got=f"{_newtons(reads)} N",
        )


def _weight(scene: Scene, path: Path, rest: slice) -> np.ndarray:
    """Return the force (3,) N, flange axes, that holds the scene's tool at rest along a part of a path."""
    axes = Rotation.from_quat(path.frame, scalar_first=True)
    axes *= Rotation.from_euler("XYZ", path.place[rest, 3:][0])
    return -tool_mass(scene) * axes.inv().apply(np.array(scene.spec().option.gravity))


def _newtons(force: np.ndarray) -> str:
    return ", ".join(f"{f:.1f}" for f in np.round(force, 1) + 0.0)  # + 0.0: no -0.0
