"""Proprioception alone, without the goal's place: the control to compare policies with images against."""

from vispeg.learn.modalities import Modality, blind, enrol

enrol(Modality("proprio", "proprio", (), blind, "proprioception and wrench only, the goal's place unknown"))
