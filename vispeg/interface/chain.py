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
    """A chain of k hinges: each adds a fixed transform from the previous frame, then a rotation about an axis.

    Attributes:
        turn: (k, 3, 3) rotation of the hinge's frame in the previous frame.
        pos: (k, 3) m, origin of the hinge's frame in the previous frame.
        anchor: (k, 3) m, a point on the hinge's axis, in the hinge's frame.
        axis: (k, 3) unit vector of the axis, in the hinge's frame.
        zero: (k,) rad, joint angle at which the hinge does not rotate.
        order: (k,) index of the hinge in joint arrays.
        end_turn: (3, 3) rotation of the flange in the last frame.
        end_pos: (3,) m, position of the flange in the last frame.
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
        """Return the rotations (n, 3, 3) from flange to base axes at joint angles q (n, nj) rad."""
        return self._walk(q)[1]

    def pose(self, q: np.ndarray, dq: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Compute pose, twist and Jacobian of the flange in the base at q and dq (n, nj), rad and rad/s.

        Returns:
            Position (n, 3) m, quaternion (n, 4) wxyz, twist (n, 6) m/s and rad/s, Jacobian (n, 6, nj).
        """
        pos, turn, axes, anchors = self._walk(q)
        jac = np.zeros((len(q), 6, q.shape[1]))
        (ax, ay, az), (x, y, z) = np.moveaxis(axes, 2, 0), np.moveaxis(pos[:, None] - anchors, 2, 0)
        jac[:, :3, self.order] = np.stack([ay * z - az * y, az * x - ax * z, ax * y - ay * x], axis=1)
        jac[:, 3:, self.order] = np.swapaxes(axes, 1, 2)
        return pos, quaternion(turn), np.matmul(jac, dq[:, :, None])[:, :, 0], jac

    def _walk(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return the flange's position (n, 3) and rotation (n, 3, 3), the hinges' axes and anchors (n, k, 3)."""
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
        """Return the chain as data for JSON, from which `from_json` restores it exactly."""
        return {f.name: getattr(self, f.name).tolist() for f in fields(self)}

    @classmethod
    def from_json(cls, entries: Mapping[str, Any]) -> Chain:
        """Make a chain from the data of `to_json`. Raises UserError: an entry is missing or has the wrong form."""
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
