"""A worker and its line in the page: what it is at, a bar, a button that stops it, and what went wrong."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from vispeg.view import html
from vispeg.view.place import Place
from vispeg.view.worker import Kind, Worker


class Job:
    """Work of a page, one piece after the other.

    Args:
        place: of the page; the line is added where the page's elements are being added.
        receive: called with (name, value) of what the work tells beside `say`.
        idle: called after each change, with whether nothing is requested any more.
    """

    def __init__(self, place: Place, receive: Callable[[str, Any], None], idle: Callable[[bool], None]):
        self.receive, self.idle, self.lock = receive, idle, threading.RLock()
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
        """Whether something that was asked for is not done."""
        return self.worker is not None and self.worker.busy

    def begin(self, make: Callable[..., object], args: tuple[Any, ...], *asked: str) -> None:
        """Give up what is running, start a new process and ask for the first things."""
        self.end()

        def start(heard: Callable[..., None]) -> Worker:
            return Worker(make, args, heard)

        self.start, self.first = start, asked
        self._fresh()

    def ask(self, method: str, *args: Any) -> None:
        """Has something done; a process that was stopped is started again first."""
        with self.lock:
            if self.worker is None or not self.worker.alive:
                self._fresh()
            if self.worker is not None:
                self.worker.ask(method, *args)
        self._shown()

    def stop(self) -> None:
        """Give up what is running; a fresh process takes up what was done before."""
        self.end()
        self._fresh()

    def end(self) -> None:
        """End the process."""
        with self.lock:
            worker, self.worker = self.worker, None
        if worker is not None:
            worker.stop()

    def _fresh(self) -> None:
        with self.lock:
            if self.start is None:
                return
            mine: list[Worker] = []

            def heard(kind: Kind, name: str, value: Any) -> None:
                if mine and mine[0] is self.worker:  # one that was given up has nothing to say
                    self._heard(kind, name, value)

            self.worker = self.start(heard)
            mine.append(self.worker)
            for method in self.first:
                self.worker.ask(method)
        self._shown()

    def _heard(self, kind: Kind, name: str, value: Any) -> None:
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
        """Show what went wrong."""
        self.trouble.content, self.trouble.visible = html.error(text), True

    def _shown(self) -> None:
        """Show whether something runs. A click and the worker's answer come in threads of their own: the one that comes
        last asks last.
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
