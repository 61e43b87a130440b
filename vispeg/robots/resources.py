"""Limits on an MJCF, checked before MuJoCo reads it, because MuJoCo would allocate whatever the file requests."""

from __future__ import annotations

import hashlib
import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import mujoco

from vispeg.core.errors import UserError
from vispeg.core.paths import expanded
from vispeg.formats.guard import MB, is_file, opened, read_text
from vispeg.formats.xml_tree import read_xml
from vispeg.robots.urdf import locate

ELEMENTS = 20_000  # greatest number of elements, copies included; arms have some hundreds
PARTS = ("include", "model")  # elements that name another MJCF
ASSETS = ("mesh", "hfield", "skin", "texture", "flexcomp")  # elements that name a file of data
COPIES = ("replicate", "composite", "flexcomp")
LARGEST = 16_384  # greatest value of the attributes in SIDES
SIDES = {
    "texture": ("width", "height"),
    "hfield": ("nrow", "ncol"),
    "global": ("offwidth", "offheight"),
    "quality": ("shadowsize",),
    "option": ("iterations", "ls_iterations", "noslip_iterations", "ccd_iterations", "sdf_iterations"),
}
# attributes with text, in which a word such as "nan" is no number
NAMES = ("name", "class", "childclass", "file", "prefix", "content", "meshdir", "texturedir", "assetdir", "model")


def check_resources(path: Path) -> None:
    """Check an MJCF and the files that it includes.

    Raises:
        UserError: a file cannot be read, is not a regular file or includes itself; a number is NaN, or infinite outside
            of a range; a range is inverted; there are too many elements; a size or number of iterations is too large.
    """
    total = _count_file(path, path.resolve().parent, ())
    if total > ELEMENTS:
        raise UserError("has too many elements", file=path, expected=f"at most {ELEMENTS}, copies counted", got=total)


def files_of(path: str | Path) -> list[Path]:
    """Return a robot's file and the files that an MJCF includes, each once; not meshes and textures."""
    if not is_file(path):
        return [Path(path)]  # its reader reports it
    files = [expanded(path).resolve()]
    for file in files if files[0].suffix.lower() != ".urdf" else ():  # `files` grows in the loop
        mentioned = (files[0].parent / name for name in _mentioned(file, _changed(file)).parts)
        files += [f for f in dict.fromkeys(m.resolve() for m in mentioned if is_file(m)) if f not in files]
    return files


def stamp(path: str | Path) -> tuple[int, ...]:
    """Return when a robot's file, the files that it includes, its meshes and textures were last changed, ns."""
    files = files_of(path)
    return tuple(_changed(file) for file in (*files, *_assets(files)))


def _changed(file: Path) -> int:
    """Return when a file was last changed, ns. Unlike its time of modification, a copy cannot keep it (`cp -p`)."""
    return file.stat().st_ctime_ns


def forget_meshes() -> None:
    """Empty MuJoCo's cache of meshes, which takes a file that is edited twice in a second for unchanged."""
    mujoco.mj_clearCache(mujoco.mj_getCache())


def digest(path: str | Path) -> str:
    """Return the SHA-256 (hex) of a robot's file, the files that it includes, and its meshes and textures."""
    files, hashed = files_of(path), hashlib.sha256()
    for file in (*files, *_assets(files)):
        with opened(file) as content:
            hashed.update(content.read())
    return hashed.hexdigest()


def _assets(files: Sequence[Path]) -> list[Path]:
    """Return the meshes, height fields, skins and textures that a robot's files name, each once; not missing ones.

    Each is looked for in every folder that any of the files states.
    """
    mentioned = [_mentioned(file, _changed(file)) for file in files if is_file(file)]
    stated = dict.fromkeys(["", *(folder for m in mentioned for folder in m.folders)])
    folders, names = [file.parent / name for file in files for name in stated], [n for m in mentioned for n in m.assets]
    tries = [locate(tried, at) for name in names for at in folders for tried in (name, Path(name).name)]
    return list(dict.fromkeys(found.resolve() for found in tries if found is not None))


@dataclass(frozen=True)
class _Mentioned:
    """What a robot's file mentions: other MJCFs that are its parts, files of data, and folders for these."""

    parts: tuple[str, ...] = ()
    assets: tuple[str, ...] = ()
    folders: tuple[str, ...] = ()


@lru_cache(maxsize=256)
def _mentioned(path: Path, stamp: int) -> _Mentioned:
    """Return what a file mentions; nothing if it cannot be read, which its reader reports."""
    try:
        elements = [*read_xml(path).iter()]
    except UserError:
        return _Mentioned()
    parts = [e.get("file", "") for e in elements if e.tag in PARTS]
    assets = [text for e in elements if e.tag in ASSETS for key, text in e.items() if key.startswith("file")]
    folders = [e.get(key, "") for e in elements if e.tag == "compiler" for key in ("meshdir", "texturedir", "assetdir")]
    return _Mentioned(*(tuple(dict.fromkeys(filter(None, found))) for found in (parts, assets, folders)))


def _count_file(path: Path, base: Path, above: tuple[Path, ...]) -> float:
    """Check a file and those that it includes, and return their number of elements, including copies."""
    if path.resolve() in above:
        raise UserError("includes itself", file=path)
    read_text(path, 64 * MB)  # checks for UTF-8, the only encoding that MuJoCo reads
    root = read_xml(path)
    if not above and root.tag != "mujoco":
        raise UserError("not an MJCF", file=path, expected="<mujoco> (a URDF is called .urdf)", got=f"<{root.tag}>")
    return _count_element(root, path, base, (*above, path.resolve()))


def _count_element(element: ET.Element, path: Path, base: Path, above: tuple[Path, ...]) -> float:
    """Check an element and those below it, and return their number, including copies."""
    if element.tag in PARTS and element.get("file"):
        try:
            return _count_file(base / element.get("file", ""), base, above)
        except UserError as error:
            raise UserError(str(error), file=path, key=element.tag) from None
    for key, text in element.attrib.items():
        if key not in NAMES:
            _numbers(text, f"{element.tag}.{key}", path)
    for key in SIDES.get(element.tag, ()):
        if _size(element.get(key)) > LARGEST:
            at = f"{element.tag}.{key}"
            raise UserError("is too large", file=path, key=at, expected=f"at most {LARGEST}", got=element.get(key))
    copies = 1.0
    if element.tag in COPIES:
        copies = math.prod(max(1.0, _size(word)) for word in (element.get("count") or "1").split())
    return copies * (1 + sum(_count_element(child, path, base, above) for child in element))


def _numbers(text: str, key: str, path: Path) -> None:
    """Check the numbers in an attribute's text. Raises UserError: one is not finite, or a range is inverted."""
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        return  # a name, or an error that MuJoCo will report
    if any(math.isnan(x) or (math.isinf(x) and not key.endswith("range")) for x in numbers):
        raise UserError("is not finite", file=path, key=key, expected="finite numbers", got=text)
    if key.endswith("range") and len(numbers) == 2 and numbers[0] > numbers[1]:  # MuJoCo would take this as no limit
        raise UserError("limits are inverted", file=path, key=key, expected="low <= high", got=text)


def _size(text: str | None) -> float:
    """Return the number in an attribute; 0 if it is missing or no number."""
    try:
        return float(text or 0)
    except ValueError:
        return 0.0  # MuJoCo will report the error
