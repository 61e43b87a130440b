"""A separate process for long work: it handles one request after the other, reports progress, and can be stopped.

It reports plain data. The page stays responsive while it works, and survives if it fails.
"""

from __future__ import annotations

import multiprocessing
import pickle
import signal
import threading
import traceback
from collections.abc import Callable
from multiprocessing.connection import Connection
from queue import SimpleQueue
from typing import Any, Literal

from vispeg.core.errors import UserError
from vispeg.core.workers import end_with_parent, one_thread

Kind = Literal["told", "done", "refused", "failed", "stopped"]
Heard = Callable[[Kind, str, Any], None]


class Worker:
    """A process that owns one object and calls its methods by name.

    Args:
        make: `make(tell, *args)` makes the object in the process; each `tell(name, value)` reaches `heard`.
        args: further arguments of `make`; must be picklable.
        heard: called from a thread of this process: ("told", name, value), ("done", method, result), ("refused",
            method, text of a UserError), ("failed", method, traceback of another error), ("stopped", method, None).
    """

    def __init__(self, make: Callable[..., object], args: tuple[Any, ...], heard: Heard):
        self.heard, self._asked = heard, list[str]()
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_work, args=(theirs, make, args), daemon=True)
        with one_thread():
            self._process.start()
        theirs.close()
        threading.Thread(target=self._listen, daemon=True).start()

    def ask(self, method: str, *args: Any) -> None:
        """Request a call of a method, after all earlier requests."""
        request = pickle.dumps((method, args))  # before it counts as asked: what cannot be sent is no request
        self._asked.append(method)
        try:
            self._pipe.send_bytes(request)
        except OSError:  # the process has died, as `_listen` reports
            self._asked.clear()

    @property
    def busy(self) -> bool:
        """Return whether a request is unfinished."""
        return bool(self._asked)

    @property
    def alive(self) -> bool:
        """Return whether the process is running."""
        return self._process.is_alive()

    def stop(self) -> None:
        """Kill the process; unfinished work is lost, written files stay."""
        self._process.kill()
        self._process.join()

    def _listen(self) -> None:
        while True:
            try:
                kind, name, value = self._pipe.recv()
            except (EOFError, OSError):
                at, self._asked = self._asked[0] if self._asked else "", []
                self.heard("stopped", at, None)
                return
            if kind != "told" and self._asked:
                self._asked.pop(0)
            try:
                self.heard(kind, name, value)
            except Exception:  # a mistake in what one answer shows must not silence those after it
                traceback.print_exc()


def _work(pipe: Connection, make: Callable[..., Any], args: tuple[Any, ...]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the page's process ends this one
    threading.Thread(target=end_with_parent, daemon=True).start()
    requests = SimpleQueue[Any]()
    threading.Thread(target=_receive, args=(pipe, requests), daemon=True).start()
    made: Any = None
    while request := requests.get():
        method, arguments = request
        try:
            if made is None:
                made = make(lambda name, value: pipe.send(("told", name, value)), *args)
            pipe.send(("done", method, getattr(made, method)(*arguments)))
        except UserError as error:
            pipe.send(("refused", method, str(error)))
        except Exception:
            pipe.send(("failed", method, traceback.format_exc()))


def _receive(pipe: Connection, requests: SimpleQueue[Any]) -> None:
    """Take requests from the pipe while others are worked on, since one that is larger than the pipe would block `ask`.

    None ends the work.
    """
    try:
        while True:
            requests.put(pipe.recv())
    except EOFError:
        pass
    finally:
        requests.put(None)
