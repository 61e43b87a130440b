"""`vispeg.combine`: combine a coarse policy with a fine one that acts near the goal."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from vispeg.api.policies import load_policy
from vispeg.core.extras import require
from vispeg.core.paths import expanded
from vispeg.report.text.summary import Block, Line, Summarised

if TYPE_CHECKING:
    from vispeg.learn.policy import Policy


@dataclass(frozen=True)
class CombinedPolicy(Summarised):
    """A coarse policy with cameras, and a fine one that takes over near the goal.

    Attributes:
        folder: folder of the combined policy.
        coarse, fine: folders or names of the two policies.
        within: distance from the goal's axis at which the fine one takes over, m.
    """

    folder: Path
    coarse: str
    fine: str
    within: float

    def open(self) -> Policy:
        """Load the combined policy."""
        return load_policy(self.folder)

    @property
    def record(self) -> dict[str, object]:
        """The output of `vispeg combine --json`."""
        return {
            "policy": str(self.folder),
            "coarse": self.coarse,
            "fine": self.fine,
            "within_mm": round(1000 * self.within, 6),
        }

    @property
    def summary(self) -> list[Block]:
        """A line that says which policy acts where."""
        text = f"{self.folder}: {Path(self.coarse).name}, from {1000 * self.within:g} mm on {Path(self.fine).name}"
        return [Line(text, path=True)]


def combine(
    coarse: str | Path, fine: str | Path, out: str | Path, *, within: float = 0.006, overwrite: bool = False
) -> CombinedPolicy:
    """Combine two policies into one folder, which can be used as a policy.

    Args:
        coarse: folder or name of the first policy, which has cameras.
        fine: folder or name of the policy that takes over; it may observe no more than the coarse one.
        out: folder of the combined policy.
        within: distance of the tip from the goal's axis, estimated by the coarse policy, at which the fine one takes
            over, m.
        overwrite: replace `out` if it exists.

    Raises:
        UserError: no such policies, policies that do not fit together, `within` not above 0 and at most 1, or `out`
            exists.
    """
    require("torch", "combining policies")
    from vispeg.learn import coarse_to_fine

    coarse_to_fine.combine(Path(coarse), Path(fine), within, expanded(out), overwrite)
    return CombinedPolicy(expanded(out), str(coarse), str(fine), within)
