"""Combines a coarse policy with a fine one for contact.

Example:
    vispeg combine depth-S state-0.5mm --within-mm 6 --out depth-then-contact
    vispeg evaluate depth-then-contact --world S {tolerance} 0.5
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from vispeg.cli.output import Output, OutputOptions


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg combine`."""

    coarse: tyro.conf.Positional[Path]
    """Folder or name of the first policy, which sees."""
    fine: tyro.conf.Positional[Path]
    """Folder or name of the policy that takes over; it may observe no more than the coarse one."""
    out: Path
    """Folder of the combined policy."""
    within_mm: float = 6.0
    """Estimated distance of the tip from the goal's axis at which the fine policy takes over, mm."""
    overwrite: bool = False
    """Replace OUT if it exists."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Write the folder."""
        from vispeg.api.learning.combine import combine

        result = combine(self.coarse, self.fine, self.out, within=self.within_mm / 1000, overwrite=self.overwrite)
        self.output.give(result.record, result.summary)
        return 0
