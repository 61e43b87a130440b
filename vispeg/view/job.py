"""A worker and its status on the page: present work, progress bar, stop button, and error message."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from vispeg.view import html
from vispeg.view.place import Place
from vispeg.view.worker import Kind, Worker


class Job:
    """Run a page's work in one worker process, one request after the other.

    Args:
        place: what all pages share; the status is added to its panels, after the elements that are there.
        receive: called with (name, value) of each message other than "say".
        idle: called after each change, with True if no request is left.
    """

    def __init__(self, place: Place, receive: Callable[[str, Any], None], idle: Callable[[bool], None]):
        self.receive, self.idle = receive, idle
        self.hearing, self.lock = threading.RLock(), threading.RLock()  # where both are held, in this order
        self.worker: Worker | None = None
        self.start: Callable[[Callable[..., None]], Worker] | None = None
        self.said: list[str] = []
        gui = place.gui
        self.line = gui.add_html("", visible=False)
        self.bar = gui.add_progress_bar(100.0, animated=True, visible=False)
        self.button = gui.add_button("Stop", icon=None, color="gray", visible=False)
        self.button.on_click(lambda _: self.stop())
        self.trouble = gui.add_html("", visible=False)

    @property
    def busy(self) -> bool:
        """Return whether a request is unfinished."""
        return self.worker is not None and self.worker.busy

    def begin(self, make: Callable[..., object], args: tuple[Any, ...], *asked: str) -> None:
        """Stop the running work, and start a process that makes `make(tell, *args)` and calls the methods `asked`."""
        self._kill()

        def start(heard: Callable[..., None]) -> Worker:
            return Worker(make, args, heard)

        self.start, self.first = start, asked
        self._fresh()

    def ask(self, method: str, *args: Any) -> None:
        """Request a call of a method; start the process again if it was stopped."""
        with self.lock:
            if self.worker is None or not self.worker.alive:
                self._fresh()
            if self.worker is not None:
                self.worker.ask(method, *args)
        self._shown()

    def stop(self) -> None:
        """Stop the running work, and start a new process that repeats the first requests."""
        self._kill()
        self._fresh()

    def end(self) -> None:
        """End the process and forget what it made; the line shows no work until `begin`."""
        self.start = None
        self._kill()
        self._shown()

    def _kill(self) -> None:
        """End the process; a message that is being handled is handled to its end, and no later one is."""
        with self.hearing, self.lock:
            worker, self.worker = self.worker, None
        if worker is not None:
            worker.stop()

    def _fresh(self) -> None:
        """Start the process that `begin` described, and repeat its first requests; do nothing before `begin`."""
        with self.lock:
            if self.start is None:
                return
            mine: list[Worker] = []  # the new worker, once it exists: messages may come before

            def heard(kind: Kind, name: str, value: Any) -> None:
                with self.hearing:
                    if mine and mine[0] is self.worker:  # ignore messages of a stopped worker
                        self._heard(kind, name, value)

            old, self.worker = self.worker, self.start(heard)
            mine.append(self.worker)
            for method in self.first:
                self.worker.ask(method)
        if old is not None:  # died, or started by another click in between
            old.stop()
        self._shown()

    def _heard(self, kind: Kind, name: str, value: Any) -> None:
        """Handle a message from the process, see `Worker`."""
        if kind == "told" and name == "say":
            self.said.append(str(value))
            self.line.content = html.note(str(value))
        elif kind == "told":
            self.receive(name, value)
        elif kind == "done":
            self.receive(f"{name} done", value)
            self._shown()
        else:
            text = "the work ended before it was done: it was killed, or the memory is full"
            self.fail(str(value).strip().splitlines()[-1] if kind != "stopped" else text)
            self._shown()

    def fail(self, text: str) -> None:
        """Show an error message."""
        self.trouble.content, self.trouble.visible = html.error(text), True

    def _shown(self) -> None:
        """Show whether work is running.

        Clicks and the worker's answers come in different threads; under the lock, the later one shows the final state.
        """
        with self.lock:
            busy = self.busy
            self.bar.visible = self.button.visible = busy
            if busy:
                self.trouble.visible = False
                if not self.line.visible:
                    self.line.content = html.note("beginning")
            self.line.visible = busy
            self.idle(not busy)
