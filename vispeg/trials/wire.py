"""Messages between the run loop and a simulated robot: a JSON header, then the arrays that it describes."""

from __future__ import annotations

import json
import socket
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np

MOST = 1 << 26  # most bytes of a message
TYPES = ("float64", "float32", "uint8")


def send(link: socket.socket, message: Mapping[str, Any], arrays: Mapping[str, np.ndarray] | None = None) -> None:
    """Send a message with named arrays, whose types are among TYPES."""
    parts = {name: np.ascontiguousarray(a) for name, a in (arrays or {}).items()}
    stated = {name: [a.dtype.name, list(a.shape)] for name, a in parts.items()}
    head = json.dumps({"message": dict(message), "arrays": stated}).encode()
    body = b"".join(a.tobytes() for a in parts.values())
    link.sendall(struct.pack("<II", len(head), len(body)) + head + body)


def receive(link: socket.socket) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Return the next message and its arrays.

    Raises:
        EOFError: the other side has disconnected.
        OSError: invalid data, or no message within the socket's timeout.
    """
    size_head, size_body = struct.unpack("<II", _exactly(link, 8))
    if size_head + size_body > MOST:
        raise OSError("not a message")
    try:
        data = json.loads(_exactly(link, size_head))
        body, arrays, at = _exactly(link, size_body), {}, 0
        for name, (kind, shape) in data["arrays"].items():
            if kind not in TYPES:
                raise ValueError(kind)
            count = int(np.prod(shape))
            arrays[name] = np.frombuffer(body, kind, count, at).reshape(shape).copy()
            at += arrays[name].nbytes
        return data["message"], arrays
    except (ValueError, KeyError, TypeError) as error:
        raise OSError("not a message") from error


def _exactly(link: socket.socket, size: int) -> bytes:
    parts = []
    while size:
        part = link.recv(min(size, 1 << 20))
        if not part:
            raise EOFError("the other side is gone")
        parts.append(part)
        size -= len(part)
    return b"".join(parts)
