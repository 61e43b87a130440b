"""Check that the required packages are installed, complete, and in the right versions."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

from vispeg.core.broken import run
from vispeg.core.extras import there as importable

_PYPROJECT = Path(__file__).parents[3] / "pyproject.toml"  # exists in a checkout, not in an installed wheel
EDITABLE, BASE = ("-e ", ".") if _PYPROJECT.is_file() else ("", "vispeg")  # how pip installs a checkout or a release
_IMPORT = """
import importlib, sys
from vispeg.core.broken import meaning
for module in sys.argv[1:]:
    try:
        importlib.import_module(module)
    except BaseException as error:
        sys.exit(f"{module}: " + meaning(error))
"""


@dataclass(frozen=True)
class Wrong:
    """A package that a release requires and that cannot be used as it is.

    Attributes:
        said: what is wrong, in words.
        broken: whether it is installed but lacks files or cannot be imported, so that pip has to install it again.
    """

    said: str
    broken: bool


def wrong_packages() -> dict[str, list[Wrong]]:
    """Return what is wrong with the packages of the base ("") and of every extra.

    Packages of the base are imported, in another process; for the others only the existence of their files is checked.
    """
    from packaging.requirements import Requirement

    groups: dict[str, list[Wrong]] = {"": []}
    present: dict[str, list[str]] = {}
    for text in _requirements():
        requirement = Requirement(text)
        extra = re.search(r"extra == ['\"]([\w-]+)['\"]", str(requirement.marker or ""))
        name = extra[1] if extra else ""
        if requirement.marker and not requirement.marker.evaluate({"extra": name}):
            continue
        wrong = groups.setdefault(name, [])
        if (fault := _version_wrong(requirement)) is not None:
            wrong.append(fault)
        else:
            present.setdefault(name, []).append(requirement.name)
    modules = _modules()
    for name, packages in present.items():
        package_of = {}
        for package in packages:
            package_of |= dict.fromkeys(modules.get(_plain(package), [_plain(package)]), package)
        if name:
            reasons = {module: "half installed" for module in package_of if not importable(module)}
        else:
            reasons = _unimportable(list(package_of))
        groups[name] += [Wrong(f"{package_of[module]}: {reason}", broken=True) for module, reason in reasons.items()]
    return groups


def _version_wrong(requirement: Any) -> Wrong | None:
    """Return what is wrong with an installed package's version; None if it is fine."""
    try:
        have = metadata.version(requirement.name)
        fits = requirement.specifier.contains(have, prereleases=True)
    except metadata.PackageNotFoundError:
        return Wrong(f"{requirement.name} is not installed", broken=False)
    except Exception:  # a metadata folder without its files
        return Wrong(f"{requirement.name} is half installed", broken=True)
    return None if fits else Wrong(f"{requirement.name} {have}, needed {requirement.specifier}", broken=False)


def _modules() -> dict[str, list[str]]:
    """Return package -> modules by which it is imported."""
    imports: dict[str, list[str]] = {}
    for module, packages in metadata.packages_distributions().items():
        for package in packages:
            if not module.startswith("_"):
                imports.setdefault(_plain(package), []).append(module)
    return {name: [name] if name in modules else modules for name, modules in imports.items()}


def _plain(package: str) -> str:
    return re.sub(r"[-_.]+", "_", package).lower()


def _unimportable(modules: Sequence[str]) -> dict[str, str]:
    """Map each module that cannot be imported to the reason; imports run in another process, which may crash."""
    remaining, reasons = list(modules), {}
    while remaining:
        ok, output = run([sys.executable, "-c", _IMPORT, *remaining], {**os.environ, "MUJOCO_GL": "disabled"}, 120.0)
        if ok:
            break
        culprit, _, reason = output.partition(": ")
        if culprit not in remaining:  # the process crashed, so each module is tried separately
            if len(remaining) == 1:
                return reasons | {remaining[0]: output}
            for module in remaining:
                reasons |= _unimportable([module])
            return reasons
        reasons[culprit] = reason
        remaining = remaining[remaining.index(culprit) + 1 :]
    return reasons


def _requirements() -> list[str]:
    """Return the required packages; in a checkout, from its pyproject.toml, as the installed metadata may be older."""
    if _PYPROJECT.is_file():
        import tomllib

        project = tomllib.loads(_PYPROJECT.read_text(encoding="utf-8"))["project"]
        extras = project["optional-dependencies"].items()
        return project["dependencies"] + [f"{text}; extra == '{name}'" for name, texts in extras for text in texts]
    try:
        return metadata.requires("vispeg") or []
    except metadata.PackageNotFoundError:
        return []
