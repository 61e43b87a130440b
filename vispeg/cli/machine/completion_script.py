"""The scripts that complete a command line: what may follow each command and option, as cases of the shell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Literal

from vispeg.cli.command import found
from vispeg.cli.options import NAMED, Option, options, subcommands

FILES = "<files>"  # stands for files and folders
Words = Mapping[str, Sequence[str]]  # option ("" for what is positional) -> what may follow it


def words() -> dict[str, Words]:
    """Command (`camera show` where it has sub-commands) -> its options with what may follow each."""
    from vispeg.cli.main import COMMANDS

    table: dict[str, Words] = {"": {"": list(COMMANDS)}}
    for name, module in COMMANDS.items():
        if ":" in module or not hasattr(import_module(module), "Args"):
            command = found(module)
            if isinstance(command, dict):
                table[name] = {"": [*command]}
            below = {f"{name} {sub}": c for sub, c in command.items()} if isinstance(command, dict) else {name: command}
            for label, each in below.items():
                options_ = each.options()
                positional = [v for o in options_ if not o.flag for v in _values(o)]
                flags = {o.flag: _values(o) for o in options_ if o.flag}
                flags |= {"--json": (), "--quiet": ()}
                table[label] = {"--help": (), **flags, "": list(dict.fromkeys(positional))}
            continue
        kind = import_module(module).Args
        below = subcommands(kind)
        if below:
            table[name] = {"": [*below]}
        for command, leaf in ({f"{name} {sub}": k for sub, k in below.items()} or {name: kind}).items():
            positional = [v for o in options(leaf) if not o.flag for v in _values(o)]
            flags = {o.flag: _values(o) for o in options(leaf) if o.flag}
            table[command] = {"--help": (), **flags, "": list(dict.fromkeys(positional))}
    return table


def script(shell: Literal["bash", "zsh", "fish"]) -> str:
    """Give the script for a shell; zsh runs the one for bash."""
    rows = words()
    if shell == "fish":
        return _fish(rows)
    head = "autoload -U +X bashcompinit && bashcompinit\n" if shell == "zsh" else ""
    return head + _bash(rows)


def _values(option: Option) -> Sequence[str]:
    """Give what may follow an option; nothing where it takes none or where any number or text will do."""
    if option.name in NAMED:
        return [*_names(NAMED[option.name]), FILES]
    return option.choices or ((FILES,) if option.path else ())


def _names(what: str) -> list[str]:
    from vispeg.api.library import catalogue
    from vispeg.core.effect import REGISTRY

    return sorted(REGISTRY) if what == "effects" else [entry.name for entry in getattr(catalogue, what)()]


def _bash(rows: Mapping[str, Words]) -> str:
    cases = []
    for command, after in rows.items():
        flags = " ".join(flag for flag in after if flag)
        cases += [f'    "{command} {flag}") {_set(values)} ;;' for flag, values in after.items() if flag and values]
        cases.append(f'    "{command} ") {_set([flags, *after.get("", ())])} ;;')
    groups = "|".join(sorted({command.split()[0] for command in rows if " " in command}))
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
    for command, after in rows.items():
        condition = " ".join(f"; and __fish_seen_subcommand_from {word}" for word in command.split()).removeprefix(
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
