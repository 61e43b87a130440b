"""Privileged: the state, and what a robot cannot know of contact and physics. A teacher that knows.

It reads no more of the ground truth than that (terms that a task shows to a `teacher`): one that read all of it, the
goal's place in the cell and the time too, learned more slowly (docs/results/training_options.md).
"""

from vispeg.learn.modalities import Modality, blind, enrol

SUMMARY = "state, contact force, slip, tilt, friction, mass, latency and what else a task shows to teachers"
enrol(Modality("privileged", "state", (), blind, SUMMARY, knows=True))
