"""Proprioception alone: no idea where the hole is. The blind control of every comparison of policies that see."""

from vispeg.learn.modalities import Modality, blind, enrol

enrol(Modality("proprio", "proprio", (), blind, "proprioception and wrench only, the hole unknown within +-30 mm"))
