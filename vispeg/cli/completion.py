"""`vispeg completion`: completion scripts for shells."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from vispeg.cli.command import Call, command, leaves
from vispeg.cli.options import NAMED, choices, plain
from vispeg.cli.overview import COMMANDS

FILES = "<files>"  # stands for files and folders
COMMON = {"--help": (), "--json": (), "--quiet": ()}
Words = Mapping[str, Sequence[str]]  # option ("" for positional arguments) -> words that may follow


@command("", "shell")
def completion(call: Call, shell: Literal["bash", "zsh", "fish"]) -> None:
    """Print the completion script of bash, zsh or fish.

    Example:
        vispeg completion bash > ~/.local/share/bash-completion/completions/vispeg
        vispeg completion zsh > ~/.vispeg-completion.zsh && echo 'source ~/.vispeg-completion.zsh' >> ~/.zshrc
        vispeg completion fish > ~/.config/fish/completions/vispeg.fish

    Args:
        shell: the shell.
    """
    if call.output.json:
        rows = {name: {flag or "": list(after) for flag, after in row.items()} for name, row in words().items()}
        call.output.give(rows, [])
    else:
        print(script(shell), end="")


def words() -> dict[str, Words]:
    """Return command (two words for a sub-command, as in `camera show`) -> option -> words that may follow."""
    table: dict[str, Words] = {"": {"": list(COMMANDS)}, "doctor": COMMON}
    for name, each in leaves().items():
        group, _, below = name.partition(" ")
        if below:
            table[group] = {"": [*table.get(group, {}).get("", ()), below]}
        after = {key: _values(option.name or key, kind) for key, (_, option, kind) in each.taken().items()}
        flags = {each.word(key): values for key, values in after.items() if key not in each.positional}
        positional = dict.fromkeys(value for key in each.positional for value in after[key])
        table[name] = {**COMMON, **flags, "": list(positional)}
    return table


def script(shell: Literal["bash", "zsh", "fish"]) -> str:
    """Return the script for a shell; zsh runs the one for bash."""
    rows = words()
    if shell == "fish":
        return _fish(rows)
    head = "autoload -U +X bashcompinit && bashcompinit\n" if shell == "zsh" else ""
    return head + _bash(rows)


def _values(name: str, kind: Any) -> Sequence[str]:
    """Return the possible values of an option; empty for a flag, and for an option that takes any number or text."""
    if name in NAMED:
        return [*_names(NAMED[name]), FILES]
    return choices(kind) or ((FILES,) if plain(kind) is Path else ())


def _names(what: str) -> list[str]:
    from vispeg.api.library import catalogue
    from vispeg.core.effect import REGISTRY

    return sorted(REGISTRY) if what == "effects" else [entry.name for entry in getattr(catalogue, what)()]


def _bash(rows: Mapping[str, Words]) -> str:
    cases = []
    for name, after in rows.items():
        flags = " ".join(flag for flag in after if flag)
        cases += [f'    "{name} {flag}") {_set(values)} ;;' for flag, values in after.items() if flag and values]
        cases.append(f'    "{name} ") {_set([flags, *after.get("", ())])} ;;')
    groups = "|".join(sorted({name.split()[0] for name in rows if " " in name}))
    return f"""_vispeg() {{
  local current="${{COMP_WORDS[COMP_CWORD]}}" before="${{COMP_WORDS[COMP_CWORD-1]}}" command="" words="" files=""
  [[ $COMP_CWORD -gt 1 ]] && command="${{COMP_WORDS[1]}}"
  case "$command" in {groups}) [[ $COMP_CWORD -gt 2 ]] && command="$command ${{COMP_WORDS[2]}}" ;; esac
  [[ $before == --* ]] || before=""
  case "$command $before" in
{chr(10).join(cases)}
    *) before=""; files=1 ;;
  esac
  COMPREPLY=($(compgen -W "$words" -- "$current"))
  [[ -n $files ]] && COMPREPLY+=($(compgen -f -- "$current"))
}}
complete -o filenames -F _vispeg vispeg
"""


def _set(values: Sequence[str]) -> str:
    plain = " ".join(value for value in values if value != FILES)
    return f'words="{plain}"' + ("; files=1" if FILES in values else "")


def _fish(rows: Mapping[str, Words]) -> str:
    lines = ["complete -c vispeg -f"]
    for name, after in rows.items():
        condition = " ".join(f"; and __fish_seen_subcommand_from {word}" for word in name.split()).removeprefix(
            "; and "
        )
        when = condition or "__fish_use_subcommand"
        for flag, values in after.items():
            plain = " ".join(value for value in values if value != FILES)
            parts = ["complete -c vispeg", f"-n '{when}'"]
            parts += [f"-l {flag[2:]}"] if flag else []
            parts += ["-r"] if flag and values else []
            parts += ["-F"] if FILES in values else []
            parts += [f"-a '{plain}'"] if plain else []
            if flag or values:
                lines.append(" ".join(parts))
    return "\n".join(lines) + "\n"
