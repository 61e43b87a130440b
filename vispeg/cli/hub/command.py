"""Sends policies and datasets to the Hugging Face hub, and fetches them from there.

A pushed dataset has the tag of its version, which LeRobot's loader looks for. What is pulled is checked before its
folder takes its name; nothing of it is executed. `HF_TOKEN` or `hf auth login` say who you are, `HF_ENDPOINT` names
another server.

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


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg hub`."""

    command: tyro.conf.OmitSubcommandPrefixes[
        Annotated[Push, tyro.conf.subcommand("push")] | Annotated[Pull, tyro.conf.subcommand("pull")]
    ]

    def run(self) -> int:
        """Runs the sub-command."""
        return self.command.run()
