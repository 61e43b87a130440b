"""Read the pose of the flange in each image, from ViSP's files (one per image) or from one CSV table."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from vispeg.core.errors import UserError
from vispeg.formats.format import enrol
from vispeg.formats.guard import read_text
from vispeg.formats.yaml_data import read_yaml
from vispeg.render.calibration.rigid import from_quaternion, transform

COLUMNS = ("file", "x", "y", "z", "qw", "qx", "qy", "qz")
FAR = 20.0  # m: no arm reaches farther, so such a number is in mm


def _table_example(folder: Path) -> Path:
    text = ",".join(COLUMNS) + "\n1.png,0.4,0.1,0.3,1,0,0,0\n2.png,0.5,0.1,0.3,0.6,0,0.8,0\n"
    (folder / "poses.csv").write_text(text, encoding="utf-8")
    return folder / "poses.csv"


def _visp_example(folder: Path) -> Path:
    for number in (1, 2):
        text = "rows: 6\ncols: 1\ndata:\n  - [0.4]\n  - [0.1]\n  - [0.3]\n  - [0]\n  - [0.1]\n  - [3.0]\n"
        (folder / f"pose_{number}.yaml").write_text(text, encoding="utf-8")
    return folder


def read_poses(path: str | Path, names: Sequence[str]) -> np.ndarray:
    """Return the flange's pose on the base for each image of `names`, base_T_flange, shape (n, 4, 4), m.

    Args:
        path: a CSV file with the columns file, x, y, z (m), qw, qx, qy, qz; or a folder of YAML files as ViSP writes
            them (`rows: 6, cols: 1, data:` x y z in m, then the rotation vector in rad). A YAML file belongs to the
            image whose name has the same last number.
        names: file names of the images.

    Raises:
        UserError: an image has no pose, a pose is invalid, or positions are in millimetres.
    """
    root = Path(path)
    if root.is_dir():
        return np.stack([_visp(root, name) for name in names])
    table = _table(root)
    for name in names:
        if name not in table:
            raise UserError("no pose for the image", file=path, key=name, expected=f"a row '{name},x,y,z,qw,qx,qy,qz'")
    return np.stack([table[name] for name in names])


# one reader for both formats; it needs the names of the images, here those of the examples
for _name, _example in (("poses (CSV)", _table_example), ("poses (ViSP)", _visp_example)):
    enrol(_name, _example)(lambda path: read_poses(path, ["1.png", "2.png"]))


def _table(path: Path) -> dict[str, np.ndarray]:
    """Return base_T_flange (4, 4) by image name from a CSV file."""
    try:
        reader = csv.DictReader(io.StringIO(read_text(path), newline=""), skipinitialspace=True)
        rows = [(reader.line_num, row) for row in reader]  # blank lines are no rows
    except csv.Error as error:
        raise UserError(f"is not CSV ({error})", file=path) from None
    missing = [column for column in COLUMNS if not rows or column not in rows[0][1]]
    if missing:
        raise UserError(f"no column {missing[0]}", file=path, expected=", ".join(COLUMNS))
    out: dict[str, np.ndarray] = {}
    for number, row in rows:
        name, where = Path(row["file"] or "").name, f"line {number}"
        if name in out:
            raise UserError("the image has two poses", file=path, key=where, got=name)
        values = _numbers([row[column] for column in COLUMNS[1:]], 7, path, where)
        norm = float(np.linalg.norm(values[3:]))
        if abs(norm - 1) > 1e-2:
            raise UserError("not a unit quaternion", file=path, key=where, expected="length 1", got=round(norm, 4))
        out[name] = _check_metres(from_quaternion(values[:3], values[3:]), path, where)
    return out


def _visp(folder: Path, name: str) -> np.ndarray:
    """Return base_T_flange (4, 4) of the image `name` from a folder of ViSP's files."""
    number = _number(name)
    files = [p for p in sorted(folder.iterdir()) if p.suffix.lower() in (".yaml", ".yml") and _number(p.name) == number]
    if number is None or len(files) != 1:
        what = "no pose" if not files else "several poses"
        raise UserError(
            f"{what} for the image '{name}'", file=folder, expected="one YAML file with the image's last number"
        )
    tree = read_yaml(files[0])
    if not isinstance(tree, dict) or not isinstance(tree.get("data"), list):
        raise UserError("not a pose as ViSP writes it", file=files[0], expected="rows: 6, cols: 1, data")
    data = [cell for row in tree["data"] for cell in (row if isinstance(row, list) else [row])]
    values = _numbers(data, 6, files[0], "data")
    return _check_metres(transform(values[3:], values[:3]), files[0], "data")


def _numbers(values: Sequence[object] | np.ndarray, count: int, path: Path, where: str) -> np.ndarray:
    try:
        out = np.array([float(value) for value in values])  # type: ignore[arg-type]  # what is no number is caught
    except (TypeError, ValueError) as error:
        raise UserError("not a pose", file=path, key=where, expected=f"{count} numbers", got=list(values)) from error
    if out.shape != (count,) or not np.isfinite(out).all():
        raise UserError("not a pose", file=path, key=where, expected=f"{count} finite numbers", got=out.tolist())
    return out


def _check_metres(pose: np.ndarray, path: Path, where: str) -> np.ndarray:
    reach = float(np.linalg.norm(pose[:3, 3]))
    if reach > FAR:
        raise UserError("farther than any arm reaches", file=path, key=where, expected="metres", got=f"{reach:.4g}")
    return pose


def _number(name: str) -> int | None:
    """Return the last number in a file's name; None if there is none."""
    numbers = re.findall(r"\d+", Path(name).stem)
    return int(numbers[-1]) if numbers else None
