"""Privileged: the state, and quantities of contact and physics that a robot cannot know. For teachers.

Of the ground truth it reads only the terms that a task shows to a `teacher`. A policy that read all of it, with the
goal's place in the cell and the time, learned more slowly (docs/results/policies.md).
"""

from vispeg.learn.modalities import Modality, blind, enrol

SUMMARY = "state, contact force, slip, tilt, friction, mass, latency and what else a task shows to teachers"
enrol(Modality("privileged", "state", (), blind, SUMMARY, knows=True))
