"""The kinematics of an arm from its base to its flange, for many arms at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.rotation import quaternion


@dataclass(frozen=True, eq=False)
class Chain:
    """Hinges one after another: each a fixed step from the frame before, then a turn about an axis.

    Attributes:
        turn: (k, 3, 3) rotation of the frame that carries a hinge, in the frame before it.
        pos: (k, 3) its origin there, m.
        anchor: (k, 3) a point of the hinge's axis in its own frame, m.
        axis: (k, 3) unit axis in its own frame.
        zero: (k,) the angle that stands for no turn, rad.
        order: (k,) which entry of joint arrays it is.
        end_turn: (3, 3) of the flange in the last frame.
        end_pos: (3,) there, m.
    """

    turn: np.ndarray
    pos: np.ndarray
    anchor: np.ndarray
    axis: np.ndarray
    zero: np.ndarray
    order: np.ndarray
    end_turn: np.ndarray
    end_pos: np.ndarray

    @cached_property
    def _turns(self) -> tuple[np.ndarray, np.ndarray]:
        """`turn K` and `turn K K` (k, 3, 3), K the cross product with the axis: Rodrigues' formula in two products."""
        x, y, z = self.axis.T
        o = np.zeros_like(x)
        cross = np.array([[o, -z, y], [z, o, -x], [-y, x, o]]).transpose(2, 0, 1)
        return self.turn @ cross, self.turn @ cross @ cross

    def rotation(self, q: np.ndarray) -> np.ndarray:
        """(n, 3, 3) flange to base at joint angles q (n, nj) rad."""
        return self._walk(q)[1]

    def pose(self, q: np.ndarray, dq: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Flange in the base: position (n, 3) m, quaternion (n, 4) wxyz, twist (n, 6) m/s and rad/s, Jacobian
        (n, 6, nj); of joint angles q and velocities dq (n, nj) rad and rad/s.
        """
        pos, turn, axes, anchors = self._walk(q)
        jac = np.zeros((len(q), 6, q.shape[1]))
        (ax, ay, az), (x, y, z) = np.moveaxis(axes, 2, 0), np.moveaxis(pos[:, None] - anchors, 2, 0)
        jac[:, :3, self.order] = np.stack([ay * z - az * y, az * x - ax * z, ax * y - ay * x], axis=1)
        jac[:, 3:, self.order] = np.swapaxes(axes, 1, 2)
        return pos, quaternion(turn), np.matmul(jac, dq[:, :, None])[:, :, 0], jac

    def _walk(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Position (n, 3) and rotation (n, 3, 3) of the flange, the hinges' axes and anchors (n, k, 3), in the base."""
        angle = q[:, self.order] - self.zero
        sine, versine = np.sin(angle)[..., None, None], 1.0 - np.cos(angle)[..., None, None]
        steps = self.turn + sine * self._turns[0] + versine * self._turns[1]
        n, k = angle.shape
        axes, anchors = np.empty((n, k, 3)), np.empty((n, k, 3))
        turn, pos = np.broadcast_to(np.eye(3), (n, 3, 3)), np.zeros((n, 3))
        for i in range(k):
            pos = pos + turn @ self.pos[i]
            axes[:, i] = turn @ (self.turn[i] @ self.axis[i])
            anchors[:, i] = pos + turn @ (self.turn[i] @ self.anchor[i])
            turn = turn @ steps[:, i]
            pos = anchors[:, i] - turn @ self.anchor[i]
        return pos + turn @ self.end_pos, turn @ self.end_turn, axes, anchors

    def to_json(self) -> Mapping[str, Any]:
        """Ready for JSON; `from_json` reads it to the same bits."""
        return {f.name: getattr(self, f.name).tolist() for f in fields(self)}

    @classmethod
    def from_json(cls, entries: Mapping[str, Any]) -> Chain:
        """Return the inverse of `to_json`. Raises UserError: an entry is missing, or is no such array."""
        k = len(entries["axis"]) if isinstance(entries, Mapping) and isinstance(entries.get("axis"), list) else 0
        shapes = {"turn": (k, 3, 3), "zero": (k,), "order": (k,), "end_turn": (3, 3), "end_pos": (3,)}
        arrays = {}
        for f in fields(cls):
            shape = shapes.get(f.name, (k, 3))
            try:
                values = np.asarray(entries[f.name], int if f.name == "order" else float)
            except (KeyError, TypeError, ValueError):
                values = np.zeros(0)
            if not k or values.shape != shape or not np.isfinite(values).all():
                raise UserError("not an arm's kinematics", key=f"arm.chain.{f.name}", expected=f"numbers {shape}")
            arrays[f.name] = values
        return cls(**arrays)
