"""Plots success over one parameter of one effect.

SWEEP is focal-length, camera-shift, camera-turn, depth-noise, light, latency, image-latency, encoder-noise, force-bias,
force-noise, friction, or EFFECT[@WHERE].PARAM[,PARAM]=VALUE,VALUE,... It may also be a model file of a diagnosis:
success without and with each of its effects; or a measurement: by how much success moves over its interval. Effects on
images need policies with cameras. Writes OUT/sensitivity.json and OUT/sensitivity.html.

Example:
    vispeg sensitivity runs/depth/best --world S --sweep focal-length --episodes 200 --out focal
    vispeg sensitivity depth-S --world S --sweep found/model.yaml --out cost
    vispeg sensitivity depth-S --world S --sweep mass.yaml --episodes 400 --out enough
    vispeg sensitivity runs/d/best runs/r/best --sweep "camera_offset@wrist_wide.x=0,0.005,0.02" --out shift
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from vispeg.cli.evaluation.trials import Played, Trials
from vispeg.core.interrupt import goes_on


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg sensitivity`."""

    policies: tyro.conf.Positional[tuple[str, ...]]
    """Policy folders, NAME=FOLDER, MODULE:CLASS or .zip files."""
    out: Path
    """Folder for the results."""
    sweep: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """SWEEP; repeat the option for each curve."""
    world: str = "nominal"
    """A built-in world's name or a world file."""
    episodes: int = 100
    """Episodes a value."""
    trials: Played = Trials()

    @goes_on()
    def run(self) -> int:
        """Plays what is missing, writes the folder, prints a line a curve."""
        from vispeg.api.stress.sensitivity import sensitivity

        result = sensitivity(
            self.policies,
            self.sweep,
            self.world,
            episodes=self.episodes,
            **self.trials.options(self.out),
        )
        self.trials.give(result, self.out / result.page)
        return 0
