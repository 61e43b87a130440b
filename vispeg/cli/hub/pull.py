"""`vispeg hub pull`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from vispeg.cli.output import Output, OutputOptions


@dataclass(frozen=True)
class Pull:
    """Pulls a policy or a dataset from a repository, and checks it."""

    repository: tyro.conf.Positional[str]
    """OWNER/NAME on the hub."""
    out: Path
    """The new folder."""
    dataset: bool = False
    """The repository holds a dataset; default: a policy."""
    revision: str | None = None
    """Branch, tag or commit."""
    overwrite: bool = False
    """Replace OUT if it exists."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Fetches it and says where it is."""
        from vispeg.api.hub.pull import pull
        from vispeg.cli.hub.transfer import transfer

        with transfer(self.output.quiet) as watch:
            came = pull(
                self.repository,
                self.out,
                dataset=self.dataset,
                revision=self.revision,
                overwrite=self.overwrite,
                watch=watch,
            )
        record = {came.kind: str(self.out), "repository": self.repository, "commit": came.commit}
        line = f"{self.out}: {came.kind} of {self.repository} at {came.commit[:8]}, {len(came.files)} files, checked"
        self.output.give({**record, "files": [*came.files]}, [line])
        return 0
