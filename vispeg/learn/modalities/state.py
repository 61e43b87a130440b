"""State: the tip's position relative to the target's believed place. For teachers."""

from vispeg.learn.modalities import Modality, blind, enrol

enrol(Modality("state", "state", (), blind, "relative position to the believed target, twist, wrench"))
