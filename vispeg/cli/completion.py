"""`vispeg completion`: completion scripts for shells.

Those that tyro makes (`--tyro-write-completion`) cannot serve: they complete no positional argument, and no name of a
world, robot, policy, motion or effect, as these are plain texts to tyro. And they start Python at each Tab, which takes
84 ms of a processor; the script made here takes 1 ms.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Literal, get_args, get_origin

from vispeg.cli.command import Call, command, leaves
from vispeg.cli.options import NAMED, choices, plain
from vispeg.cli.overview import COMMANDS

ZSH = """(( $+functions[compdef] )) || { autoload -U compinit && compinit; }
autoload -U +X bashcompinit && bashcompinit
"""
# After `--option value` an option of several values goes on, any other has ended. Names of files may have spaces.
# bash makes three words of `--option=value`.
BASH = """_vispeg() {{
  local current="${{COMP_WORDS[COMP_CWORD]}}" command="" option="" words="" files="" i=$((COMP_CWORD - 1))
  [[ $COMP_CWORD -gt 1 ]] && command="${{COMP_WORDS[1]}}"
  case "$command" in {groups}) [[ $COMP_CWORD -gt 2 ]] && command="$command ${{COMP_WORDS[2]}}" ;; esac
  while [[ $i -gt 0 && "${{COMP_WORDS[i]}}" != --* ]]; do i=$((i - 1)); done
  [[ $i -gt 0 && "$current" != -* ]] && option="${{COMP_WORDS[i]}}"
  [[ "${{COMP_WORDS[i+1]}}" == "=" && $((i + 1)) -lt $COMP_CWORD ]] && i=$((i + 1))
  [[ "$current" == "=" ]] && current=""
  case "$command|$option|$((COMP_CWORD - i))" in
{cases}
  esac
  COMPREPLY=($(compgen -W "$words" -- "$current"))
  local IFS=$'\\n'
  [[ -n $files ]] && COMPREPLY+=($(compgen -f -- "$current"))
}}
complete -o filenames -F _vispeg vispeg
"""


@dataclass(frozen=True)
class Values:
    """The values of an option or of a command's positional arguments: those with names, files, one or several."""

    names: tuple[str, ...] = ()
    files: bool = False
    several: bool = False


Words = Mapping[str, Values | None]  # option ("" for positional arguments) -> its values; None for a switch
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
        rows = {name: {flag: after and asdict(after) for flag, after in row.items()} for name, row in words().items()}
        call.output.give(rows, [])
    else:
        print(script(shell), end="")


def words() -> dict[str, Words]:
    """Return command (two words for a sub-command, as in `camera show`) -> option -> its values, as in `Words`."""
    commands = Values(tuple(COMMANDS))
    table: dict[str, Words] = {"": {"": commands}, "help": {"": commands}, "doctor": COMMON}
    names = cache(_names)  # many options take a policy or a world, and to list these takes seconds
    for name, each in leaves().items():
        group, _, below = name.partition(" ")
        if below:
            table[group] = {"": Values((*getattr(table.get(group, {}).get(""), "names", ()), below))}
        after = {}
        for key, (_, option, kind) in each.taken().items():
            word = option.name or key
            known = names(NAMED[word]) if word in NAMED else choices(kind)
            basic = plain(kind)
            several = option.repeats or any(get_origin(part) is tuple for part in (kind, *get_args(kind)))
            switch = not known and basic is None
            after[key] = None if switch else Values(known, word in NAMED or basic is Path, several)
        flags = {each.word(key): values for key, values in after.items() if key not in each.positional}
        placed = [values for key in each.positional if (values := after[key])]
        positional = tuple(dict.fromkeys(name for values in placed for name in values.names))
        table[name] = {**COMMON, **flags, "": Values(positional, any(values.files for values in placed))}
    return table


def script(shell: Literal["bash", "zsh", "fish"]) -> str:
    """Return the script for a shell; zsh runs the one for bash, after its own completion is loaded."""
    rows = words()
    if shell == "fish":
        return _fish(rows)
    return (ZSH if shell == "zsh" else "") + _bash(rows)


def _names(what: str) -> tuple[str, ...]:
    from vispeg.api.library import catalogue
    from vispeg.core.effect import REGISTRY

    return tuple(sorted(REGISTRY)) if what == "effects" else tuple(entry.name for entry in getattr(catalogue, what)())


def _bash(rows: Mapping[str, Words]) -> str:
    cases = []
    for name, after in rows.items():
        for flag, values in after.items():
            if flag and values:
                pattern = f'"{name}|{flag}|"*' if values.several else f'"{name}|{flag}|1"'
                cases.append(f"    {pattern}) {_set(values.names, values.files)} ;;")
        positional = after.get("") or Values()
        flags = filter(None, after)
        cases.append(f'    "{name}|"*) {_set((*flags, *positional.names), positional.files)} ;;')
    groups = "|".join(sorted({name.split()[0] for name in rows if " " in name}))
    return BASH.format(groups=groups, cases="\n".join(cases))


def _set(names: tuple[str, ...], files: bool) -> str:
    return f'words="{" ".join(names)}"' + ("; files=1" if files else "")


def _fish(rows: Mapping[str, Words]) -> str:
    lines = ["complete -c vispeg -f"]
    for name, after in rows.items():
        seen = "; and ".join(f"__fish_seen_subcommand_from {word}" for word in name.split())
        for flag, values in after.items():
            parts = ["complete -c vispeg", f"-n '{seen or '__fish_use_subcommand'}'"]
            parts += [f"-l {flag[2:]}"] if flag else []
            parts += ["-r"] if flag and values else []
            parts += ["-F"] if values and values.files else []
            parts += [f"-a '{' '.join(values.names)}'"] if values and values.names else []
            lines += [" ".join(parts)] if len(parts) > 2 else []
    return "\n".join(lines) + "\n"
