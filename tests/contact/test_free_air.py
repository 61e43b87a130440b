"""Free air, where nothing but the tool's own mass and weight may be read: Newton's law, and the sensor's zero."""

from __future__ import annotations

import numpy as np
from pressed import SCENE
from scipy.spatial.transform import Rotation

from vispeg.contact.drive import drive
from vispeg.contact.hand import hand
from vispeg.contact.items import driven
from vispeg.contact.path import Path, jacobian
from vispeg.contact.run import evidence_of
from vispeg.core.seeds import stream
from vispeg.recordings.cell import CellBelief
from vispeg.recordings.noise import NOISE
from vispeg.robots.tools import CELL
from vispeg.task.belief import believed
from vispeg.task.rig.commanded import CellMotion
from vispeg.task.rig.motions import Place, free
from vispeg.task.rig.path import commands
from vispeg.task.rig.record import record_cell
from vispeg.worlds.world import World

DOWN = np.array([0.0, 1.0, 0.0, 0.0])  # the flange looks down
STEP = 2e-3


def swung(amplitude: float, hz: float = 0.5) -> Path:
    """3 s from rest, back and forth along the hand's x axis, high over the table."""
    time = np.arange(1500) * STEP
    soft, way = np.clip((time - 0.5) / 0.5, 0.0, 1.0), 2 * np.pi * hz
    place = np.zeros((len(time), 6))
    place[:, 0] = amplitude * soft**3 * (10 - 15 * soft + 6 * soft**2) * np.sin(way * (time - 0.5))
    rate = np.gradient(place, STEP, axis=0)
    rows = np.arange(len(time))
    read = np.zeros_like(place)
    start, goal = np.array([0.6, 0.0, 0.6]), np.zeros(3)
    return Path(STEP, time, start, DOWN, place, rate, jacobian(place[:, 3:]), read, goal, rows, time)


def test_what_moves_a_hand_in_free_air_is_its_mass_times_its_acceleration():
    """Read as nothing, the whole force that a swing needs is the correction: `F = m a`, to a hundredth."""
    path = swung(0.1)
    one = hand(SCENE)
    windows, zeros = [slice(0, len(path.time))], np.zeros((1, len(path.time), 6))
    out = drive(one, SCENE, path, [World()], zeros, slice(0, 200), windows, 1)
    model, steady = one.compile(), np.abs(path.time - 2.0) < 0.8
    mass = model.body_subtreemass[model.body(one.base).id]
    wanted, got = mass * np.gradient(path.rate[:, 0], STEP)[steady], out.correction[0, steady, 0]
    assert np.abs(got - wanted).max() < 0.01 * np.abs(wanted).max()
    slope = float(got @ wanted / (wanted @ wanted))
    assert abs(slope - 1.0) < 0.01, "dampers counted at a step's start are as a sixth of the hand's mass"


def test_the_zero_is_read_before_the_hand_turns_about_its_tip():
    """A tilt leaves the tip where it is and turns the weight in the sensor: a sensor without bias has no zero."""
    world = World("iiwa14", CELL, cell=CellBelief("nominal"))
    found = believed(world.cell)
    time, frames = free(Place(found.scene, stream(1, "tilts"))).frames(500.0)
    some = slice(0, 800)
    made = CellMotion("free", time[some], commands(frames, found.scene, found.config.stiffness)[some])
    item = evidence_of([record_cell(world, made, NOISE, stream(2, "tilts"))]).items[0]
    turned = Rotation.from_euler("XYZ", item.path.place[:, 3:]).magnitude()
    assert turned.max() > 0.01, "the motion does tilt"
    assert turned[item.phase.rest].max() < 0.002
    assert np.abs(driven(item, [World()]).zero[0, :3]).max() < 0.03  # N; of readings good to 0.1 N
