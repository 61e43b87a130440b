"""Prints the completion script of bash, zsh or fish.

Example:
    vispeg completion bash > ~/.local/share/bash-completion/completions/vispeg
    vispeg completion zsh > ~/.vispeg-completion.zsh && echo 'source ~/.vispeg-completion.zsh' >> ~/.zshrc
    vispeg completion fish > ~/.config/fish/completions/vispeg.fish
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import tyro

from vispeg.cli.output import Output, OutputOptions


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg completion`."""

    shell: tyro.conf.Positional[Literal["bash", "zsh", "fish"]]
    """The shell."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Print the script."""
        from vispeg.cli.machine.completion_script import script, words

        if self.output.json:
            self.output.give(
                {command: {f or "": list(v) for f, v in row.items()} for command, row in words().items()}, []
            )
        else:
            print(script(self.shell), end="")
        return 0
