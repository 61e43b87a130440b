"""File endings of exported formats."""

from pathlib import Path

from vispeg.core.errors import UserError

ENDINGS = {"onnx": ".onnx", "mjcf": ".xml", "urdf": ".urdf"}


def check_ending(out: Path, to: str) -> None:
    """Raise UserError if a file's ending does not match its format."""
    if out.suffix.lower() != ENDINGS[to]:
        expected = f"a name that ends in {ENDINGS[to]} (--to {to})"
        raise UserError(f"not an {to.upper()} file", key="--out", expected=expected, got=str(out))
