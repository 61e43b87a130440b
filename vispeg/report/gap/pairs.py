"""The same episode in two worlds side by side: videos, and pictures of the moment of failure."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from vispeg.core.errors import UserError

TITLE, SINGLE = "The same episode in two worlds", "Episodes, filmed"
TYPES = {".mp4": "video/mp4", ".png": "image/png", ".jpg": "image/jpeg"}


def context(pairs: Sequence[Mapping[str, Any]], folder: Path) -> Mapping[str, object]:
    """Return the pairs with their media as data URIs.

    Args:
        pairs: {policy, train_seed, seed, sides: [{world, outcome, video, image, view}, ...]}. `video` is the whole
            episode, `image` the outside view and `view` the policy's own at the moment of failure; paths relative to
            `folder`, or None. Older results have no `train_seed`.
        folder: folder of the media.
    """
    rows = []
    for pair in pairs:
        sides = [
            {**side, **{k: data_uri(folder, side.get(k)) for k in ("video", "image", "view")}} for side in pair["sides"]
        ]
        rows.append({"policy": pair["policy"], "trained": pair.get("train_seed"), "seed": pair["seed"], "sides": sides})
    return {"pairs": rows}


def data_uri(folder: Path, name: str | None) -> str | None:
    """Return a file's content as a data URI.

    Raises:
        UserError: the file does not exist, or is not a video or picture that a browser shows.
    """
    if name is None:
        return None
    path = folder / name
    kind = TYPES.get(path.suffix)
    if kind is None or not path.is_file():
        raise UserError("not a video or picture", file=path, expected=", ".join(TYPES))
    return f"data:{kind};base64,{base64.b64encode(path.read_bytes()).decode()}"
