"""Packages that come with an extra of this package alone, and the one line to say where one of them is missing."""

from __future__ import annotations

from importlib.util import find_spec

from vispeg.core.assets import PACKAGE
from vispeg.core.errors import UserError

# extra -> what it lets one import; as in pyproject.toml, but for `dev`
EXTRAS = {
    "learn": ("torch", "stable_baselines3", "tensorboard", "safetensors", "onnx", "onnxruntime"),
    "meshes": ("coacd",),
    "logs": ("rosbags", "h5py"),
    "video": ("av",),
    "cluster": ("ray",),
    "view": ("viser", "websockets"),
    "wandb": ("wandb",),
    "menagerie": ("mujoco_menagerie",),
}


def install(extra: str) -> str:
    """Give the command that installs an extra; a checkout is installed from where it stands."""
    checkout = (PACKAGE.parent / "pyproject.toml").is_file()
    return f"pip install -e '.[{extra}]'" if checkout else f"pip install 'vispeg[{extra}]'"


def missing(module: str, what: str = "this", **where: str) -> UserError:
    """Give the error for a module of an extra that is not there.

    Args:
        module: as it is imported.
        what: needs it.
        where: `file` and `key` at fault, for UserError.
    """
    root = module.partition(".")[0]
    extra = next(name for name, modules in EXTRAS.items() if root in modules)
    return UserError(f"{what} needs {root}, of the extra '{extra}'", expected=install(extra), **where)


def lacks(error: ImportError) -> str | None:
    """Return the module of an extra whose absence made an import fail; None if it failed for another reason."""
    root = (error.name or "").partition(".")[0]
    return root if any(root in modules for modules in EXTRAS.values()) and not there(root) else None


def there(module: str) -> bool:
    """Whether a module is installed, without importing it."""
    try:
        return find_spec(module) is not None
    except ImportError:
        return False


def require(module: str, what: str) -> None:
    """Raise UserError where a module of an extra is missing that `what` needs, before any work is begun."""
    if not there(module):
        raise missing(module, what)
