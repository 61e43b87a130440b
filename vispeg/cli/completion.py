"""`vispeg completion`: completion scripts for shells.

Those that tyro makes (`--tyro-write-completion`) cannot serve: they complete no positional argument, and no name of a
world, robot, policy, motion or effect, as these are plain texts to tyro. And they start Python at each Tab, which takes
84 ms of a processor; the script made here takes 1 ms.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
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
# bash makes three words of `--option=value`, zsh and fish make one, which `compgen -f` of zsh does not complete.
BASH = """_vispeg() {{
  local current="${{COMP_WORDS[COMP_CWORD]}}" command="" option="" prefix="" words="" files="" i=$((COMP_CWORD - 1))
  [[ $COMP_CWORD -gt 1 ]] && command="${{COMP_WORDS[1]}}"
  case "$command" in {groups}) [[ $COMP_CWORD -gt 2 ]] && command="$command ${{COMP_WORDS[2]}}" ;; esac
  while [[ $i -gt 0 && "${{COMP_WORDS[i]}}" != --* ]]; do i=$((i - 1)); done
  [[ $i -gt 0 && "$current" != -* ]] && option="${{COMP_WORDS[i]}}"
  [[ "${{COMP_WORDS[i+1]}}" == "=" && $((i + 1)) -lt $COMP_CWORD ]] && i=$((i + 1))
  [[ "$current" == "=" ]] && current=""
  [[ "$current" == --*=* ]] && prefix="${{current%%=*}}=" current="${{current#*=}}" i=$((COMP_CWORD - 1))
  [[ -n $prefix ]] && option="${{prefix%=}}"
  case "$command|$option|$((COMP_CWORD - i))" in
{cases}
  esac
  COMPREPLY=($(compgen -P "$prefix" -W "$words" -- "$current"))
  local IFS=$'\\n'
  [[ -n $files && -z $prefix ]] && COMPREPLY+=($(compgen -f -- "$current"))
  [[ -n $files && -n $prefix ]] && for i in "$current"*; do [[ -e "$i" ]] && COMPREPLY+=("$prefix$i"); done
}}
complete -o filenames -F _vispeg vispeg
"""
FISH = """function __vispeg
    set -l before (commandline -opc)
    set -l current (commandline -ct)
    set -l command $before[2]
    contains -- "$command" {groups}; and set command $before[2..3]
    set -l i (count $before)
    set -l after 1
    while test $i -gt 1; and not string match -q -- '--*' $before[$i]
        set i (math $i - 1)
        set after (math $after + 1)
    end
    set -l option
    test $i -gt 1; and not string match -q -- '-*' $current; and set option $before[$i]
    set -l parts (string match -r -- '^(--[^=]+)=' $current); and set option $parts[2]; and set after 1
    set -l words
    set -l files
    switch "$command|$option|$after"
{cases}
    end
    if test "$argv" = files
        test -n "$files"
    else if test -n "$parts"
        string match -q -- '-*' $words; or printf '%s\\n' $parts[1]$words
    else if string match -q -- '-*' $current
        string match -- '-*' $words
    else
        string match -v -- '-*' $words
    end
end
complete -c vispeg -f -a '(__vispeg)'
complete -c vispeg -n '__vispeg files' -F
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
        vispeg completion bash > ~/.vispeg-completion.bash && echo 'source ~/.vispeg-completion.bash' >> ~/.bashrc
        vispeg completion zsh > ~/.vispeg-completion.zsh && echo 'source ~/.vispeg-completion.zsh' >> ~/.zshrc
        mkdir -p ~/.config/fish/completions && vispeg completion fish > ~/.config/fish/completions/vispeg.fish

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
    groups = sorted({name.split()[0] for name in rows if " " in name})
    if shell == "fish":
        cases = "\n".join(
            f"        case '{pattern}'\n            {_set(values, shell)}" for pattern, values in _cases(rows)
        )
        return FISH.format(groups=" ".join(groups), cases=cases)
    cases = "\n".join(
        f'    "{pattern.rstrip("*")}"{"*" * pattern.endswith("*")}) {_set(values, shell)} ;;'
        for pattern, values in _cases(rows)
    )
    return (ZSH if shell == "zsh" else "") + BASH.format(groups="|".join(groups), cases=cases)


def _names(what: str) -> tuple[str, ...]:
    from vispeg.api.library import catalogue
    from vispeg.core.effect import REGISTRY
    from vispeg.recordings.cell import OPEN_CELL

    if what == "effects":
        return tuple(sorted(REGISTRY))
    if what == "models":
        return tuple(dict.fromkeys((*_names("robots"), OPEN_CELL, *_names("worlds"))))
    return tuple(dict.fromkeys(entry.name for entry in getattr(catalogue, what)()))


def _cases(rows: Mapping[str, Words]) -> Iterator[tuple[str, Values]]:
    """Yield `command|option|number of the word after it`, where * stands for any text, and what can stand there."""
    for name, after in rows.items():
        for flag, values in after.items():
            if flag and values:
                yield f"{name}|{flag}|{'*' if values.several else 1}", values
        positional = after.get("") or Values()
        yield f"{name}|*", Values((*filter(None, after), *positional.names), positional.files)


def _set(values: Values, shell: str) -> str:
    names = " ".join(values.names)
    if shell == "fish":
        return f"set words {names}" + ("; set files 1" if values.files else "")
    return f'words="{names}"' + ("; files=1" if values.files else "")
