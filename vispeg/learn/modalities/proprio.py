"""Proprioception alone: no idea where the goal is. The blind control of every comparison of policies that see."""

from vispeg.learn.modalities import Modality, blind, enrol

enrol(Modality("proprio", "proprio", (), blind, "proprioception and wrench only, the goal's place unknown"))
