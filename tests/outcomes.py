"""Collect the files that a command has written, to compare two runs of it."""

import json
from pathlib import Path


def results(folder: Path) -> dict[str, bytes]:
    """Return the content of each file below a folder, without how the command was called and how long it took."""
    return {
        file.relative_to(folder).as_posix(): _timeless(file)
        for file in sorted(folder.rglob("*"))
        if file.is_file() and not {"tensorboard", "begun.json"} & {*file.relative_to(folder).parts}
    }


def _timeless(file: Path) -> bytes:
    if file.suffix == ".html":  # has its record in it
        return b""
    if file.name == "progress.csv":
        return b"\n".join(
            b",".join([*line.split(b",")[:1], *line.split(b",")[2:]]) for line in file.read_bytes().split()
        )
    if file.suffix != ".json":
        return file.read_bytes()
    record = json.loads(file.read_text())
    for key in ("provenance", "version"):
        record.pop(key, None) if isinstance(record, dict) else None
    text = json.dumps(record, sort_keys=True)
    for name in ("whole", "killed"):
        text = text.replace(name, "OUT")
    return text.encode()
