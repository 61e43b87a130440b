"""Privileged: the state, and the ground truth that critics see: friction, mass, latency, contact; a teacher."""

from vispeg.learn.modalities import Modality, blind, enrol

enrol(Modality("privileged", "state", (), blind, "state, and the ground truth of physics and contact", truth=True))
