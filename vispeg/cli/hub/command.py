"""Pushes and pulls policies and datasets, Hugging Face hub.

`pull` checks the files before the folder gets its name, and executes nothing. A pushed dataset has the tag of its
version, which LeRobot's loader looks for. `HF_TOKEN` or `hf auth login` is your identity; `HF_ENDPOINT` names another
server.

Example:
    vispeg hub push frames someone/frames
    vispeg hub pull someone/frames --dataset --out frames
    vispeg hub pull someone/policy --out policy
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import tyro

from vispeg.cli.hub.pull import Pull
from vispeg.cli.hub.push import Push
from vispeg.cli.options import subcommand


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg hub`."""

    command: tyro.conf.OmitSubcommandPrefixes[Annotated[Push, subcommand(Push)] | Annotated[Pull, subcommand(Pull)]]

    def run(self) -> int:
        """Runs the sub-command."""
        return self.command.run()
