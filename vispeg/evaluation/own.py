"""Policies of a user's own: objects, functions, `MODULE:NAME` of either, and what other tools saved.

A policy is a function of the observation, an object with `act(obs)`, or an object with `predict`, such as a model of
Stable-Baselines3, which is called with `deterministic=True`. Observations are arrays (n, ...) by key, actions (n, d)
within +-1. An object may have:

* `reset(n, rows)`, called when episodes begin. n episodes are played side by side; `rows` (n,) bool marks those that
  begin, None all. A policy whose `reset` takes no rows plays one episode at a time.
* `obs_mode`: what it observes (default: `state`).
* `task`: the settings of the task that it was made for, such as {"stack": 1}.
* `measured = True`: also pass it readings in SI units, (n, nj + 12), see `vispeg.task.environments.vector.TaskVec`.
* `action`: the kind of its actions, one of `vispeg.interface.actions.KINDS`, where they are not offsets within +-1.
  `?action=KIND` at the end of a text that names a policy states the same.

A module is named as gymnasium names environments; loading it runs its code. Nothing in a file by Stable-Baselines3 is
executed, see `vispeg.learn.sb3_policy`. The metadata of an ONNX file state what its inputs and outputs mean, as
`vispeg export` writes them (docs/formats.md); ONNX Runtime plays it, whichever tool trained it. `lerobot:FOLDER` is a
policy that LeRobot saved, see `vispeg.evaluation.lerobot`.
"""

from __future__ import annotations

import importlib
import inspect
import re
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.counts import count
from vispeg.core.errors import UserError
from vispeg.core.extras import require
from vispeg.core.paths import expanded
from vispeg.evaluation.lerobot import LeRobot, folder_of, run_of
from vispeg.interface.actions import OFFSET, Actions, checked, split
from vispeg.interface.exported import Exported
from vispeg.interface.interface import Interface
from vispeg.interface.lerobot import PREFIX
from vispeg.interface.terms import MEASURED, POLICY, PRIVILEGED
from vispeg.learn.meta import INTERFACE, MadeIn, worlds
from vispeg.render.image_kinds import DEPTH, MODES, camera_of, grey_depth, kind_of

MODULE = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")
EXPECTED = (
    "a policy's folder, NAME=FOLDER, MODULE:NAME, an .onnx file, a .zip by Stable-Baselines3, lerobot:FOLDER, "
    "a function, or an object with act"
)
FILES = (".zip", ".onnx")


def is_file(text: str) -> bool:
    """Return whether a text names a .zip by Stable-Baselines3 or an ONNX file."""
    return Path(text).suffix.lower() in FILES


def is_own(text: str) -> bool:
    """Return whether a text names a user's own policy: such a file, a folder of LeRobot's, or `MODULE:NAME`."""
    text = split(text)[0]
    return is_file(text) or text.startswith(PREFIX) or (MODULE.fullmatch(text) is not None and not Path(text).exists())


def made(source: Any) -> Any:
    """Return the policy that `source` names or is; a class is instantiated without arguments.

    Raises:
        UserError: no such module or file, a class that cannot be instantiated, or an object that cannot act.
    """
    target = source = split(source)[0] if isinstance(source, str) else source
    if isinstance(source, str) and source.lower().endswith(".zip"):
        require("torch", f"the policy {source}")
        from vispeg.learn.sb3_policy import opened

        target = opened(expanded(source))
    elif isinstance(source, str) and is_file(source):
        target = Exported(expanded(source))
    elif isinstance(source, str) and source.startswith(PREFIX):
        target = LeRobot(folder_of(source))
    elif isinstance(source, str):
        target = _imported(source)
    if inspect.isclass(target):
        try:
            target = target()
        except Exception as error:  # whatever the user's code raises
            raise UserError(f"cannot be made ({_where(error)})", got=_label(source)) from error
    if not (callable(target) or callable(getattr(target, "act", None)) or callable(getattr(target, "predict", None))):
        raise UserError("not a policy", expected=EXPECTED, got=_label(source))
    return target


def called(text: str) -> str:
    """Return the default name in tables of the policy that a text names."""
    text = split(text)[0]
    if is_file(text):
        return Path(text).stem
    return run_of(folder_of(text)) if text.startswith(PREFIX) else text.rpartition(":")[2]


def origin(source: Any) -> Path | None:
    """Return the file or folder of a policy that is named by a text; None for an object."""
    if not isinstance(source, str):
        return None
    source = split(source)[0]
    if is_file(source):
        return expanded(source)
    if source.startswith(PREFIX):
        return folder_of(source)
    return Path(inspect.getfile(importlib.import_module(source.partition(":")[0])))


def _imported(text: str) -> Any:
    module, _, name = text.partition(":")
    try:
        return getattr(importlib.import_module(module), name)
    except Exception as error:  # a module may raise anything while it is imported
        expected = "a module on PYTHONPATH or installed, and a class, function or object in it"
        raise UserError(f"no such policy ({_where(error)})", expected=expected, got=text) from error


def acts(source: Any, target: Any) -> str | None:
    """Return the kind of a policy's actions; None where nothing states it.

    `?action=KIND` in `source`, the text that names the policy, comes before the policy's own attribute `action`.

    Raises:
        UserError: an unknown kind, or a kind stated for an exported policy, whose file states it.
    """
    stated = split(source)[1] if isinstance(source, str) else None
    if isinstance(target, Exported):
        if stated is not None:
            raise UserError("is stated by the exported policy itself", file=target.path, key="action", got=stated)
        return OFFSET  # it turns its actions into offsets by itself
    attribute = getattr(target, "action", None)
    kind = attribute if stated is None and isinstance(attribute, str) else stated
    return None if kind is None else checked(kind, origin(source))


def observes(target: Any, name: str) -> tuple[str, dict[str, Any]]:
    """Return a policy's observation mode, and the task settings that it was made for.

    Raises:
        UserError: no such mode or setting, or a policy that reads the ground truth.
    """
    if isinstance(target, Exported):
        return target.interface.modality, _stated(target.interface)
    space = getattr(getattr(target, "observation_space", None), "spaces", None)
    if space is not None:
        return _of_space(space, name)
    mode = getattr(target, "obs_mode", "state")
    if mode not in MODES:
        raise UserError(f"{name} observes what no environment shows", key="obs_mode", got=mode, choices=MODES)
    task = getattr(target, "task", None) or {}
    unknown = [key for key in task if key not in INTERFACE] if isinstance(task, Mapping) else [task]
    if unknown:
        raise UserError(f"{name}: not a policy's setting", key="task", got=unknown[0], choices=INTERFACE)
    return mode, dict(task)


def _stated(i: Interface) -> dict[str, Any]:
    """Return the task settings (`vispeg.learn.meta.INTERFACE`) that an interface states."""
    task = {"name": i.task, "stack": i.stack, "dof": i.dof, "policy_period": i.policy_period_s}
    task |= {"offset": i.offset_m, "turn": i.turn_rad}
    if i.images:
        task["cameras"] = tuple(dict.fromkeys(camera_of(key) for key in i.images))
        task["image_size"] = min(min(seen.shape[1:]) for seen in i.images.values())
    return task


def made_in(target: Any) -> MadeIn:
    """Return the world that a policy states it was trained in, as entries of a record; empty if it states none."""
    if not isinstance(target, Exported):
        return worlds()
    i = target.interface
    stated = {"world": i.world, "world_hash": i.world_hash, "world_hashes": i.world_hashes}
    return worlds({**stated, "world_parts": i.world_parts} if i.world_parts else stated)


def exported(target: Any) -> str:
    """Return the digest of the policy that `vispeg export` wrote as this file; empty for other policies."""
    return target.interface.policy if isinstance(target, Exported) else ""


def _of_space(space: Mapping[str, Any], name: str) -> tuple[str, dict[str, Any]]:
    """Return what `observes` does, from the observation space of a policy by Stable-Baselines3."""
    if PRIVILEGED in space:
        what = f"{name} reads '{PRIVILEGED}', the ground truth, which no robot has"
        raise UserError(what, expected="one trained in an environment with privileged=False")
    shapes = {key: part.shape for key, part in space.items()}
    kinds = {kind_of(key) for key in shapes if key != POLICY}
    if None in kinds:
        others = [key for key in shapes if key != POLICY and kind_of(key) is None]
        raise UserError(f"{name} observes what no environment shows", got=others[0], choices=[POLICY, "depth_CAMERA"])
    # several modes have no images: of these, `state`
    mode = next((m for m, seen in MODES.items() if set(seen) == kinds and (seen or m == "state")), "state")
    task: dict[str, Any] = {}
    if kinds:
        pictures = {key: shape for key, shape in shapes.items() if key != POLICY}
        usual = ("wrist_wide", "wrist_crop")  # the order of a task's own cameras; a space's keys are sorted by name
        names = dict.fromkeys(camera_of(key) for key in pictures)
        task["cameras"] = tuple(sorted(names, key=lambda c: usual.index(c) if c in usual else len(usual)))
        task["image_size"] = min(min(shape[1:]) for shape in pictures.values())
    return mode, task


class Own:
    """Wrap a user's own policy in the interface of `vispeg.learn.policy.Policy`.

    Args:
        target: the user's policy.
        name: its name, for errors.
        mode: its observation mode.
        actions: the meaning of its actions.
    """

    meta: Mapping[str, Any] = {}
    estimate: np.ndarray | None = None
    recurrent = 0

    def __init__(self, target: Any, name: str, mode: str, actions: Actions):
        self.target, self.name, self.modality, self.actions = target, name, mode, actions
        self._space = getattr(getattr(target, "observation_space", None), "spaces", None)

    def reset(self, n: int, rows: np.ndarray | None = None) -> None:
        """See Policy."""
        begin = getattr(self.target, "reset", None)
        if callable(begin) and self._space is None:
            self._call(begin, *(n, rows)[: places(begin)])

    def act(self, obs: Mapping[str, np.ndarray]) -> np.ndarray:
        """See Policy. Raises UserError where the policy fails or does not return finite actions (n, d)."""
        n, widths = len(obs[POLICY]), self.actions.widths
        hidden = (PRIVILEGED,) if getattr(self.target, "measured", False) else (PRIVILEGED, MEASURED)
        seen = {key: value for key, value in obs.items() if key not in hidden}
        if self._space is not None:
            seen = {key: self._fitted(key, seen) for key in self._space}
        if callable(getattr(self.target, "act", None)):
            out = self._call(self.target.act, seen)
        elif callable(getattr(self.target, "predict", None)):
            out = self._call(lambda: self.target.predict(seen, deterministic=True)[0])
        else:
            out = self._call(self.target, seen)
        if hasattr(out, "detach"):
            out = out.detach().cpu().numpy()
        try:
            actions = np.asarray(out, dtype=np.float32)
        except (TypeError, ValueError):
            actions = np.empty(0, np.float32)
        if n == 1 and actions.ndim == 1:
            actions = actions[None]
        fits = actions.ndim == 2 and len(actions) == n and actions.shape[-1] in widths
        if not fits or not np.isfinite(actions).all():
            shapes, each = " or ".join(f"({n}, {k})" for k in widths), f"an action for each of {count(n, 'episode')}"
            got = "numbers that are not finite" if fits else np.shape(out)
            raise UserError(
                f"{self.name} gives no actions", expected=f"finite numbers of shape {shapes}: {each}", got=got
            )
        if self.actions.kind == OFFSET:
            return actions
        nj = len(self.actions.joints)
        return self.actions.offset(actions, self.actions.seen(obs[MEASURED][:, :nj])).astype(np.float32)

    def _fitted(self, key: str, obs: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the observation at `key` in the type of the policy's space. Raises UserError where it cannot fit."""
        assert self._space is not None
        wanted, value = self._space[key], obs.get(key)
        if value is not None and kind_of(key) is DEPTH and wanted.dtype == np.uint8:
            value = grey_depth(value)
        if value is None or value.shape[1:] != wanted.shape or value.dtype != wanted.dtype:
            got = None if value is None else f"{value.dtype} {value.shape[1:]}"
            what = f"{self.name} was made for another observation"
            raise UserError(what, key=key, expected=f"{wanted.dtype} {wanted.shape}", got=got)
        return value

    def _call(self, function: Callable[..., Any], *args: Any) -> Any:
        try:
            return function(*args)
        except UserError:
            raise
        except Exception as error:  # whatever the user's code raises
            raise UserError(f"{self.name} failed: {_where(error)}") from error


def places(function: Callable[..., Any]) -> int:
    """Return the number of positional arguments that a function takes; 2 for one with `*args`."""
    kinds = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    parameters = inspect.signature(function).parameters.values()
    if any(p.kind == inspect.Parameter.VAR_POSITIONAL for p in parameters):
        return 2
    return sum(p.kind in kinds for p in parameters)


def plays_alone(target: Any) -> bool:
    """Return whether a policy's `reset` takes no rows, so that it can play only one episode at a time."""
    begin = getattr(target, "reset", None)
    return callable(begin) and not hasattr(target, "observation_space") and places(begin) < 2


def _where(error: Exception) -> str:
    """Return an error of the user's code as one line, with its file and line."""
    at = traceback.extract_tb(error.__traceback__)[-1]
    text = (str(error).splitlines() or [""])[0]
    place = "" if at.filename.startswith("<frozen") else f" at {Path(at.filename).name}:{at.lineno}"
    return f"{type(error).__name__}: {text}{place}"


def _label(source: Any) -> str:
    """Return the text that names a policy, or the name of an object or its class, for errors."""
    return source if isinstance(source, str) else getattr(source, "__name__", type(source).__name__)
