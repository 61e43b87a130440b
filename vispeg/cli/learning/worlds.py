"""Lists the worlds that come with the package. Every option --world takes their names.

Example:
    vispeg worlds
    vispeg worlds --search sensor
"""

from __future__ import annotations

from dataclasses import dataclass

from vispeg.cli.output import Output, OutputOptions


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg worlds`."""

    family: str | None = None
    """Only those of one kind: `fixed` or `randomized`."""
    search: str | None = None
    """Only those with this text in their name or description."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Prints the list."""
        from vispeg.api.library.catalogue import worlds
        from vispeg.cli.listing import show

        return show("worlds", worlds(), "kind", self.family, self.search, self.output)
