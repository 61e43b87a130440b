"""Lists the bundled policies, whose names stand for their folders.

Example:
    vispeg policies
    vispeg policies --family depth
"""

from __future__ import annotations

from dataclasses import dataclass

from vispeg.cli.output import Output, OutputOptions


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg policies`."""

    family: str | None = None
    """Only policies of this modality: state, proprio, depth, rgb, rgbd."""
    search: str | None = None
    """Only policies with this text in name or description."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Print the list."""
        from vispeg.api.library.catalogue import policies
        from vispeg.cli.listing import show

        return show("policies", policies(), "sees", self.family, self.search, self.output)
