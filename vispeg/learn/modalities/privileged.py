"""Privileged: the state, and what a robot cannot know of contact and physics. A teacher that knows.

It reads no more of the ground truth than that: one that read all of it, the hole's place in the cell and the time too,
learned more slowly (docs/results/training_options.md).
"""

from vispeg.learn.modalities import Modality, blind, enrol
from vispeg.task.observe import CONTACT, PHYSICS

SUMMARY = "state, contact force, slip, tilt, friction, mass, latency, clearance"
enrol(Modality("privileged", "state", (), blind, SUMMARY, truth=(*CONTACT, *PHYSICS)))
