"""Lists the motions that `vispeg record --motion` takes by name.

Example:
    vispeg motions
    vispeg motions --family joint
"""

from __future__ import annotations

from dataclasses import dataclass

from vispeg.cli.output import Output, Told


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg motions`."""

    family: str | None = None
    """List those in `joint`, or in `cartesian`, space alone."""
    search: str | None = None
    """List those that have this text in their name or words."""
    output: Told = Output()

    def run(self) -> int:
        """Prints the list."""
        from vispeg.api.catalogue import motions
        from vispeg.cli.listing import show

        return show(motions(), "space", self.family, self.search, self.output)
