"""Load policies saved by Stable-Baselines3 without unpickling anything.

For every object that JSON cannot hold, the file stores a pickle and, as text, the object's attributes. The policy's
class and the observation space are read from the text; of the weights, only tensors are loaded.
"""

from __future__ import annotations

import importlib
import io
import json
import re
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium import spaces

from vispeg.core.errors import UserError
from vispeg.formats.guard import MB
from vispeg.formats.json_data import parse_json

LARGEST = 2000 * MB  # largest unpacked member of the .zip
BOX = re.compile(r"'([^']+)': Box\(([^,]+), ([^,]+), \(([\d, ]+)\), (\w+)\)")  # as gymnasium prints a Dict space


def opened(path: Path) -> Any:
    """Load the policy in a .zip saved by Stable-Baselines3, ready to `predict`.

    Raises:
        UserError: no such file, a file of another kind, a policy whose action is no vector, or one that uses a user's
            own classes, which are stored as pickled code.
    """
    if not path.is_file():
        raise UserError("no such policy", file=path, expected="a .zip by Stable-Baselines3")
    try:
        with zipfile.ZipFile(path) as archive:
            for part in ("data", "policy.pth"):
                if archive.getinfo(part).file_size > LARGEST:
                    raise UserError("is too large", file=path, key=part)
            data, weights = parse_json(archive.read("data"), path, "data", finite=False), archive.read("policy.pth")
        kind, kwargs = data["policy_class"], data["policy_kwargs"]
        module, name = str(kind["__module__"]), str(kind["__init__"]).split()[1].partition(".")[0]
        parts = BOX.findall(str(data["observation_space"]["spaces"]))
        action_space = data["action_space"]
        action = str(action_space["_shape"]).strip("[]")
    except (zipfile.BadZipFile, OSError, ValueError, KeyError, TypeError, IndexError, AttributeError) as error:
        expected = "a policy that Stable-Baselines3 saved in one of vispeg's environments"
        raise UserError(f"not such a file ({type(error).__name__}: {error})", file=path, expected=expected) from error
    # arguments are read from the text, never from the pickle
    kwargs = {k: _plain(v, path) for k, v in kwargs.items() if k not in (":type:", ":serialized:")}
    if not module.startswith("stable_baselines3."):
        raise UserError("is of a class of your own", file=path, key=module, expected="MODULE:FUNCTION that loads it")
    if not action.isdigit():
        expected, kind = "a vector of numbers within +-1 (Box)", action_space.get(":type:")
        raise UserError("acts otherwise", file=path, key="action_space", expected=expected, got=kind)
    space: dict[str, spaces.Space[Any]] = {
        key: spaces.Box(float(low), float(high), tuple(int(n) for n in shape.split(",") if n.strip()), np.dtype(dtype))
        for key, low, high, shape, dtype in parts
    }
    bounded = spaces.Box(-1.0, 1.0, (int(action),), np.float32)
    try:
        policy = getattr(importlib.import_module(module), name)(spaces.Dict(space), bounded, lambda _: 0.0, **kwargs)
        policy.load_state_dict(torch.load(io.BytesIO(weights), map_location="cpu", weights_only=True))
    except Exception as error:  # torch and Stable-Baselines3 may raise anything
        reason = (str(error).splitlines() or [type(error).__name__])[0][:160]
        raise UserError(f"cannot be opened: {reason}", file=path, expected="MODULE:FUNCTION that loads it") from error
    policy.set_training_mode(False)
    return policy


def _plain(value: Any, path: Path) -> Any:
    """Return an argument from the file's text. Raises UserError for one that JSON cannot hold, such as a class."""
    if isinstance(value, str) and value in ("True", "False", "None"):
        return {"True": True, "False": False, "None": None}[value]
    if isinstance(value, str) and re.match(r"[\[{(<]", value):
        try:
            return json.loads(value.replace("'", '"'))
        except ValueError:
            what = "its networks are of classes of your own, which are stored as code"
            raise UserError(what, file=path, key="policy_kwargs", expected="MODULE:FUNCTION that loads it") from None
    return value
