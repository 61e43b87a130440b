"""`vispeg completion`: completion scripts for shells."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, Literal

from vispeg.cli.command import Call, command, leaves
from vispeg.cli.options import NAMED, choices, plain
from vispeg.cli.overview import COMMANDS

FILES = "<files>"  # stands for files and folders
ZSH = """(( $+functions[compdef] )) || { autoload -U compinit && compinit; }
autoload -U +X bashcompinit && bashcompinit
"""
Words = Mapping[str, Sequence[str] | None]  # option ("" for positional arguments) -> its values; None for a switch
COMMON: Words = dict.fromkeys(("--help", "--json", "--quiet"))


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
        rows = {name: {flag: list(after or ()) for flag, after in row.items()} for name, row in words().items()}
        call.output.give(rows, [])
    else:
        print(script(shell), end="")


def words() -> dict[str, Words]:
    """Return command (two words for a sub-command, as in `camera show`) -> option -> its values, as in `Words`."""
    table: dict[str, Words] = {"": {"": list(COMMANDS)}, "doctor": COMMON}
    names = cache(_names)  # many options take a policy or a world, and to list these takes seconds
    for name, each in leaves().items():
        group, _, below = name.partition(" ")
        if below:
            table[group] = {"": [*(table.get(group, {}).get("") or ()), below]}
        after = {key: _values(option.name or key, kind, names) for key, (_, option, kind) in each.taken().items()}
        flags = {each.word(key): values for key, values in after.items() if key not in each.positional}
        positional = dict.fromkeys(value for key in each.positional for value in after[key] or ())
        table[name] = {**COMMON, **flags, "": list(positional)}
    return table


def script(shell: Literal["bash", "zsh", "fish"]) -> str:
    """Return the script for a shell; zsh runs the one for bash, after its own completion is loaded."""
    rows = words()
    if shell == "fish":
        return _fish(rows)
    return (ZSH if shell == "zsh" else "") + _bash(rows)


def _values(name: str, kind: Any, names: Callable[[str], list[str]]) -> Sequence[str] | None:
    """Return the known values of an option; empty if it takes any number or text, None for a switch."""
    if name in NAMED:
        return [*names(NAMED[name]), FILES]
    if few := choices(kind):
        return few
    basic = plain(kind)
    if basic is None:
        return None
    return (FILES,) if basic is Path else ()


def _names(what: str) -> list[str]:
    from vispeg.api.library import catalogue
    from vispeg.core.effect import REGISTRY

    return sorted(REGISTRY) if what == "effects" else [entry.name for entry in getattr(catalogue, what)()]


def _bash(rows: Mapping[str, Words]) -> str:
    cases = []
    for name, after in rows.items():
        flags = " ".join(flag for flag in after if flag)
        cases += [f'    "{name} {flag}") {_set(values)} ;;' for flag, values in after.items() if flag and values]
        # after no option or a switch, all options and the positional values may follow
        before = "|".join(f'"{name} {flag}"' for flag in ("", *(f for f in after if f and after[f] is None)))
        cases.append(f"    {before}) {_set([flags, *(after.get('') or ())])} ;;")
    groups = "|".join(sorted({name.split()[0] for name in rows if " " in name}))
    return f"""_vispeg() {{
  local current="${{COMP_WORDS[COMP_CWORD]}}" before="${{COMP_WORDS[COMP_CWORD-1]}}" command="" words="" files=""
  [[ $COMP_CWORD -gt 1 ]] && command="${{COMP_WORDS[1]}}"
  case "$command" in {groups}) [[ $COMP_CWORD -gt 2 ]] && command="$command ${{COMP_WORDS[2]}}" ;; esac
  [[ $before == --* ]] || before=""
  case "$command $before" in
{chr(10).join(cases)}
    *) files=1 ;;
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
            values = values or ()
            plain = " ".join(value for value in values if value != FILES)
            parts = ["complete -c vispeg", f"-n '{when}'"]
            parts += [f"-l {flag[2:]}"] if flag else []
            parts += ["-r"] if flag and values else []
            parts += ["-F"] if FILES in values else []
            parts += [f"-a '{plain}'"] if plain else []
            if flag or values:
                lines.append(" ".join(parts))
    return "\n".join(lines) + "\n"
