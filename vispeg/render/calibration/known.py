"""Read known intrinsics from a file in the format of this project, OpenCV, ROS or ViSP."""

from __future__ import annotations

import re
from pathlib import Path

from vispeg.core.errors import UserError
from vispeg.formats.format import enrol
from vispeg.formats.guard import read_text
from vispeg.render.calibration.intrinsics import Intrinsics
from vispeg.render.cameras.camera_files import load_camera


def _example(folder: Path) -> Path:
    numbers = {"image_width": 640, "image_height": 480, "px": 600.0, "py": 602.0, "u0": 322.0, "v0": 243.0, "kud": 0}
    tags = "".join(f"<{tag}>{value}</{tag}>\n" for tag, value in numbers.items())
    text = f'<?xml version="1.0"?>\n<root>\n<camera>\n{tags}</camera>\n</root>\n'
    (folder / "visp.xml").write_text(text, encoding="utf-8")
    return folder / "visp.xml"


@enrol("camera model (ViSP)", _example)
def read_intrinsics(path: str | Path) -> Intrinsics:
    """Return the intrinsics in a file.

    Args:
        path: a YAML file that `vispeg.render.cameras.camera_files` reads (of the project, OpenCV or ROS camera_info),
            or the XML of ViSP's vpXmlParserCamera without distortion.

    Raises:
        UserError: the file is missing, or has none of these formats.
    """
    file = Path(path)
    if file.suffix.lower() != ".xml":
        camera = load_camera(file)
        k1, k2, p1, p2, k3 = camera.distortion
        size, focal, centre = (camera.width, camera.height), (camera.fx, camera.fy), (camera.cx, camera.cy)
        return Intrinsics(size, focal, centre, (k1, k2, p1, p2, k3))
    return _visp(read_text(file), file)


def _visp(text: str, file: Path) -> Intrinsics:
    """Return the intrinsics in ViSP's XML.

    The file is one flat table and is read by its tags alone, since an XML parser would also follow entities.

    Raises:
        UserError: a tag is missing, occurs more than once or is not a number, or there is distortion.
    """
    text = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)

    def value(tag: str, default: float | None = None) -> float:
        matches = re.findall(rf"<{tag}>\s*([-+.\deE]+)\s*</{tag}>", text)
        if not matches and default is not None:
            return default
        if len(matches) != 1:
            raise UserError(
                "not the XML of one ViSP camera model", file=file, key=tag, expected="once", got=len(matches)
            )
        try:
            return float(matches[0])
        except ValueError as error:
            raise UserError("not a number", file=file, key=tag, got=matches[0]) from error

    if value("kud", 0.0) != 0:
        raise UserError("ViSP's distortion is not Brown's", file=file, key="kud", expected=0, got=value("kud"))
    width, height = int(value("image_width")), int(value("image_height"))
    return Intrinsics((width, height), (value("px"), value("py")), (value("u0"), value("v0")))
