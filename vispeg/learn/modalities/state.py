"""State: the position relative to where the target is believed to be. The teacher."""

from vispeg.learn.modalities import Modality, blind, enrol

enrol(Modality("state", "state", (), blind, "relative position to the believed target, twist, wrench"))
