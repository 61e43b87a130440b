"""Privileged: the state, and what a robot cannot know of contact and physics. A teacher that knows.

It reads no more of the ground truth than that. An actor that reads all of it, with the hole's place in the cell and the
time, follows its critics into their mistakes, which depend on the same numbers (docs/results/training_options.md).
"""

from vispeg.learn.modalities import Modality, blind, enrol
from vispeg.task.observe import CONTACT, PHYSICS

SUMMARY = "state, contact force, slip, tilt, friction, mass, latency, clearance"
enrol(Modality("privileged", "state", (), blind, SUMMARY, truth=(*CONTACT, *PHYSICS)))
