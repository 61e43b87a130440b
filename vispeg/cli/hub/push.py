"""`vispeg hub push`."""

from __future__ import annotations

from dataclasses import dataclass

import tyro

from vispeg.cli.output import Output, OutputOptions


@dataclass(frozen=True)
class Push:
    """Pushes a policy or a dataset to a repository, which is made if need be."""

    folder: tyro.conf.Positional[str]
    """Folder of a policy or of a rendered dataset, or a bundled policy's name."""
    repository: tyro.conf.Positional[str]
    """OWNER/NAME on the hub."""
    revision: str | None = None
    """Branch to push to. A dataset gets its tag only on the main branch."""
    private: bool = False
    """Make the new repository private."""
    overwrite: bool = False
    """Replace the policy or dataset there by a new commit."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Sends it and says where it is."""
        from vispeg.api.hub.push import push
        from vispeg.cli.hub.transfer import transfer

        with transfer(self.output.quiet) as watch:
            sent = push(
                self.folder,
                self.repository,
                revision=self.revision,
                private=self.private,
                overwrite=self.overwrite,
                watch=watch,
            )
        record = {"repository": self.repository, "kind": sent.kind, "commit": sent.commit, "url": sent.url}
        tagged = f", tag {sent.tag}" if sent.tag else ""
        line = f"{sent.kind}: {self.repository}, {len(sent.files)} files{tagged}"
        self.output.give({**record, "tag": sent.tag, "files": [*sent.files]}, [line, sent.url])
        return 0
