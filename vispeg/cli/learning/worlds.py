"""Lists the worlds that come with the package, by the names that --world takes.

Example:
    vispeg worlds
    vispeg worlds --search sensor
"""

from __future__ import annotations

from dataclasses import dataclass

from vispeg.cli.output import Output, Told


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg worlds`."""

    family: str | None = None
    """List those that are `fixed`, or `randomized`, alone."""
    search: str | None = None
    """List those that have this text in their name or words."""
    output: Told = Output()

    def run(self) -> int:
        """Prints the list."""
        from vispeg.api.catalogue import worlds
        from vispeg.cli.listing import show

        return show("worlds", worlds(), "kind", self.family, self.search, self.output)
