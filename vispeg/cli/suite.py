"""Run a regression suite over versions of a policy.

`run` plays one version in the training world and in a target, in named configurations, and writes OUT/suite.json and
OUT/suite.html. `compare` reads such folders, oldest first: the correlation between training world and target over the
versions (healthy above 0.8, alarm below 0.6), and regressions of the last version on the same seeds. A mean loss above
5 points with 95 % confidence is an alarm too. Exit code 1 on an alarm or a regression, for CI.

Example:
    vispeg suite run runs/{task}-depth/best --train S --target VNP --version 3 --out suite/v3
    vispeg suite run runs/{task}-depth/best --train S --measured robot.csv --version 3 --out suite/v3
    vispeg suite compare suite/v1 suite/v2 suite/v3 --out suite/compared
"""

from __future__ import annotations

from pathlib import Path

from vispeg.cli.command import Call, Option, command
from vispeg.cli.judging import OUT, played
from vispeg.core.errors import UserError
from vispeg.core.interrupt import goes_on


@command("vispeg.api.stress.suite:suite", "policies", configurations=Option("suite"), out=OUT)
@goes_on()
def run(call: Call) -> int:
    """Play the suite with one version of a policy.

    Example:
        vispeg suite run runs/{task}-depth/best --train S --target VNP --version 3 --out suite/v3
    """
    result = played(call)
    call.give(result, str(call.out / "suite.html"))
    return 1 if result.alarm else 0


@command("vispeg.api.stress.versions:compare_versions", "folders")
def compare(call: Call, out: Path | None = None, overwrite: bool = False) -> int:
    """Compare versions, oldest first.

    Example:
        vispeg suite compare suite/v1 suite/v2 suite/v3 --out suite/compared

    Args:
        out: folder for compare.json and suite.html; default: write nothing.
        overwrite: replace the result in `out`.
    """
    if not call.folders:
        raise UserError("nothing to compare", expected="vispeg suite compare FOLDER [FOLDER ...]")
    result = call()
    call.give(result, *([] if out is None else [str(result.save(out, overwrite=overwrite) / "suite.html")]))
    return 1 if result.alarm else 0
