"""Lists the policies that come with the package, by the names that every command takes for a folder.

Example:
    vispeg policies
    vispeg policies --family depth
"""

from __future__ import annotations

from dataclasses import dataclass

from vispeg.cli.output import Output, Told


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg policies`."""

    family: str | None = None
    """List those that see this alone: `state`, `proprio`, `depth`, `rgb`, `rgbd`."""
    search: str | None = None
    """List those that have this text in their name or words."""
    output: Told = Output()

    def run(self) -> int:
        """Prints the list."""
        from vispeg.api.catalogue import policies
        from vispeg.cli.listing import show

        return show("policies", policies(), "sees", self.family, self.search, self.output)
