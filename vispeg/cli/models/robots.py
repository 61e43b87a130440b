"""Lists the arms that go by a name, and which of them are here.

Any other arm is a path to its MJCF or URDF. Menagerie's own folders, and FOLDER/ENTRY, are names too. What `downloads`
is fetched once, when it is first asked for.

Example:
    vispeg robots
    vispeg diagnose so101 --recording log-a log-b --validate log-c --out found
"""

from __future__ import annotations

from dataclasses import dataclass

from vispeg.cli.output import Output, OutputOptions


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg robots`."""

    family: str | None = None
    """Only arms of this kind: built in, here, downloads or not here."""
    search: str | None = None
    """Only arms with this text in name or description."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Print the list, and how to get what is not here."""
        from vispeg.api.library.catalogue import robots
        from vispeg.cli.listing import show
        from vispeg.robots.menagerie import ABSENT, HOW

        entries = robots()
        absent = any(entry.family == ABSENT for entry in entries)
        ending = f"what is not here needs {HOW}" if absent else ""
        return show("robots", entries, "is", self.family, self.search, self.output, ending)
