"""`vispeg.load_policy`: load a policy from its folder, or a bundled one by name."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from vispeg.core.extras import require

if TYPE_CHECKING:
    from vispeg.learn.policy import Policy


def load_policy(place: str | Path) -> Policy:
    """Load a policy. After `policy.reset(n)`, `policy.act(observations)` returns actions (n, action) within +-1.

    Args:
        place: a folder with policy.json and policy.safetensors, or a bundled policy's name
            (`vispeg policies` lists them). Nothing in the folder is executed.

    Raises:
        UserError: no such policy, a file is missing or damaged, or torch is not installed.
    """
    require("torch", f"the policy {place}")
    from vispeg.learn.coarse_to_fine import open_policy

    return open_policy(place)
