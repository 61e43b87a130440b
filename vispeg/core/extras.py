"""Optional dependencies (extras of this package), and the error if one is missing."""

from __future__ import annotations

from importlib.util import find_spec

from vispeg.core.assets import PACKAGE
from vispeg.core.errors import UserError

# extra -> modules that it installs; the extras of pyproject.toml except `dev`
EXTRAS = {
    "learn": ("torch", "stable_baselines3", "tensorboard", "safetensors", "onnx", "onnxruntime"),
    "meshes": ("coacd",),
    "logs": ("rosbags", "h5py"),
    "video": ("av",),
    "cluster": ("ray",),
    "view": ("viser", "websockets"),
    "wandb": ("wandb",),
    "menagerie": ("mujoco_menagerie",),
    "warp": ("mujoco_warp",),
}


def install(extra: str) -> str:
    """Return the command that installs an extra: of this checkout, or of the published package."""
    checkout = (PACKAGE.parent / "pyproject.toml").is_file()
    return f"pip install -e '.[{extra}]'" if checkout else f"pip install 'vispeg[{extra}]'"


def missing(module: str, what: str = "this", **where: str) -> UserError:
    """Return the error for a module of an extra that is not installed.

    Args:
        module: its name in an import.
        what: what needs it, as the subject of a sentence.
        where: `file` and `key` at fault, for UserError.
    """
    root = module.partition(".")[0]
    extra = next(name for name, modules in EXTRAS.items() if root in modules)
    return UserError(f"{what} needs {root}, of the extra '{extra}'", expected=install(extra), **where)


def lacks(error: ImportError) -> str | None:
    """Return the module of an extra whose absence made an import fail with `error`; None for any other reason."""
    root = (error.name or "").partition(".")[0]
    return root if any(root in modules for modules in EXTRAS.values()) and not there(root) else None


def there(module: str) -> bool:
    """Return whether a module is installed, without importing it."""
    try:
        return find_spec(module) is not None
    except ImportError:
        return False


def require(module: str, what: str) -> None:
    """Raise UserError if a module of an extra that `what` needs is not installed; call it before long work."""
    if not there(module):
        raise missing(module, what)
