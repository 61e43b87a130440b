"""Lists the policies that come with the package. Every command takes their names in place of a folder.

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
    """Only those of one modality: `state`, `proprio`, `depth`, `rgb`, `rgbd`."""
    search: str | None = None
    """Only those with this text in their name or description."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Prints the list."""
        from vispeg.api.library.catalogue import policies
        from vispeg.cli.listing import show

        return show("policies", policies(), "sees", self.family, self.search, self.output)
