"""Privileged: the state, and the ground truth that critics see: friction, mass, latency, contact. A teacher that knows."""

from vispeg.learn.modalities import Modality, blind, enrol

enrol(Modality("privileged", "state", (), blind, "state, and the ground truth of physics and contact", truth=True))
