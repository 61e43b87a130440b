"""Protect the page: a token, a check of the request's origin, and a limit on dropped files."""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
import socket
from collections.abc import Callable, Iterator
from functools import partial
from http import HTTPStatus
from pathlib import Path
from tempfile import mkstemp
from typing import Any
from urllib.parse import parse_qs, urlencode, urlsplit

from vispeg.core.errors import UserError
from vispeg.formats.guard import size

HOST = "127.0.0.1"
PORT, NEXT = 8080, 100  # the first port to try, and how many to try from there
UPLOADS = 1_000_000_000  # most bytes of dropped files in all, as they are held in memory; larger logs are named by path
REFUSED = "403: open the address that `vispeg view` printed, with its token.\n"


def free_port(asked: int | None) -> int:
    """Return a free port of this machine: the one asked for, or the first free one from `PORT` on.

    Raises:
        UserError: not a port number, a port in use or reserved, or no port is free.
    """
    if asked is not None and not 1 <= asked <= 65535:
        raise UserError("is no port", key="--port", expected="1 to 65535", got=asked)
    for port in range(PORT, PORT + NEXT) if asked is None else (asked,):
        with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as trial:
            # as the server does: a port that was just closed counts as free
            trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                trial.bind((HOST, port))
                return port
            except OSError as error:
                why = error
        if asked is not None:
            taken = why.errno == errno.EADDRINUSE
            reason = "something listens there already" if taken else (why.strerror or str(why)).lower()
            raise UserError(reason, key="--port", expected="a free port, or none, for the first free one", got=asked)
    raise UserError("no port is free", key="--port", expected=f"one of {PORT} to {PORT + NEXT - 1}, or another")


class Gate:
    """Admit requests that carry the token and, for the websocket, come from the page's own address.

    The token is in the query of every request, the websocket's included. It is not in a cookie, because a browser sends
    cookies to every port of this machine, so also to servers of other accounts.

    Attributes:
        token: the token, random at each start.
    """

    def __init__(self) -> None:
        self.token = secrets.token_urlsafe(32)

    def url(self, port: int) -> str:
        """Return the address to open in a browser."""
        return f"http://{HOST}:{port}/?{urlencode({'token': self.token})}"

    @contextlib.contextmanager
    def guarding(self) -> Iterator[None]:
        """Let servers that are created in the body of `with` ask this gate about each request."""
        import websockets.asyncio.server as library

        plain: Any = library.serve

        def serve(*args: Any, process_request: Callable[..., Any], **options: Any) -> Any:
            return plain(*args, process_request=partial(self.answer, process_request), **options)

        library.serve = serve
        try:
            yield
        finally:
            library.serve = plain

    def answer(self, plain: Callable[..., Any], connection: Any, request: Any) -> Any:
        """Refuse a request, redirect a window to the address that names the websocket, or let viser answer."""
        query = parse_qs(urlsplit(request.path).query)
        given = query.get("token", [""])[0]
        if not secrets.compare_digest(given.encode(), self.token.encode()):
            return connection.respond(HTTPStatus.FORBIDDEN, REFUSED)
        port = connection.local_address[1]
        response = plain(connection, request)
        if response is None:  # a websocket begins
            same_origin = request.headers.get_all("Origin") == [f"http://{HOST}:{port}"]
            return None if same_origin else connection.respond(HTTPStatus.FORBIDDEN, REFUSED)
        if "websocket" not in query:  # viser's script reads its server's address here
            to = {"token": self.token, "websocket": f"ws://{HOST}:{port}/?{urlencode({'token': self.token})}"}
            response = connection.respond(HTTPStatus.FOUND, "")
            response.headers["Location"] = f"/?{urlencode(to)}"
        response.headers["Referrer-Policy"] = "no-referrer"
        response.headers["Cache-Control"] = "no-store"
        response.headers["X-Frame-Options"] = "DENY"
        return response


def opener(folder: Path, url: str) -> Path:
    """Write an HTML file that redirects to the address and that only this account can read; return its path.

    The browser is started with this path: other accounts could read the token in an address on a command line.
    """
    folder.mkdir(parents=True, exist_ok=True)
    handle, name = mkstemp(".html", "open-", folder)
    with os.fdopen(handle, "w", encoding="utf-8") as file:
        file.write(f'<!doctype html><meta charset="utf-8"><meta http-equiv="refresh" content="0; url={url}">\n')
    return Path(name)


def limit_uploads(server: Any, most: int = UPLOADS) -> None:
    """Limit a viser server to `most` bytes of dropped files in all, and each file to its announced size.

    viser keeps dropped files in memory without a limit, so its two handlers of uploads are wrapped. The handlers of its
    sharing, a tunnel through an outside server, are removed.
    """
    from viser import _messages as messages

    gui, link = server.gui, server.gui._websock_interface
    arrived = [0]  # bytes of whole files; a list, because a handler changes it
    arriving = gui._current_file_upload_states  # without those of closed windows
    begin, part = gui._handle_file_transfer_start, gui._handle_file_transfer_part

    def begun(client: int, message: Any) -> None:
        room = most - arrived[0] - sum(state["total_bytes"] for state in arriving.values())
        if not 0 <= message.size_bytes <= room:
            window = server.get_clients().get(client)
            if window is not None:
                text = f"{size(room)} of {size(most)} are left; name the path of the file instead, or start again."
                window.add_notification("Too large to be dropped", text, color="red")
            return
        begin(client, message)

    def came(client: int, message: Any) -> None:
        state = arriving.get(message.transfer_uuid)
        if state is None:  # never begun
            return
        if state["transferred_bytes"] + len(message.content) > state["total_bytes"]:  # more than announced
            arriving.pop(message.transfer_uuid, None)
            return
        part(client, message)
        if message.transfer_uuid not in arriving:
            arrived[0] += state["transferred_bytes"]

    for kind, old, new in (
        (messages.FileTransferStartUpload, begin, begun),
        (messages.FileTransferPart, part, came),
    ):
        link.unregister_handler(kind, old)
        link.register_handler(kind, new)
    for kind in (messages.ShareUrlRequest, messages.ShareUrlDisconnect):
        server._websock_server.unregister_handler(kind)
