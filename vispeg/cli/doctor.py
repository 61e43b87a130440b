"""Check this machine: what is missing, and how to get it.

Exit code 0: recordings can be checked, fitted and diagnosed here. Pictures,
logs, training and videos are extras.

Example:
    vispeg doctor
    vispeg doctor --json > machine.json
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from typing import NoReturn

from vispeg.core.errors import UserError


def doctor(argv: Sequence[str]) -> int:
    """Print the findings; return 0 if nothing that the base needs is missing, else 1.

    The arguments are parsed by argparse, because the parser of the other commands may itself be missing.
    """
    form = argparse.RawDescriptionHelpFormatter
    parser = _Parser("vispeg doctor", description=__doc__, formatter_class=form, allow_abbrev=False)
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    parser.add_argument("--quiet", action="store_true", help="print only what is missing")
    args = parser.parse_args(argv)
    from vispeg.api.machine.doctor import examine

    machine = examine()
    if text := json.dumps(machine.record, indent=2) if args.json else machine.text(args.quiet):
        print(text)
    return 0 if machine.healthy else 1


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise UserError(f"{message}; see vispeg doctor --help")
