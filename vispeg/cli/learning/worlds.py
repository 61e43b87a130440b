"""Lists the built-in worlds, the names that --world takes.

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
    """Only worlds of this kind: fixed or randomized."""
    search: str | None = None
    """Only worlds with this text in name or description."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Print the list."""
        from vispeg.api.library.catalogue import worlds
        from vispeg.cli.listing import show

        return show("worlds", worlds(), "kind", self.family, self.search, self.output)
