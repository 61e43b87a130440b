"""Light or dark: as each window's system has it, until somebody chooses."""

from __future__ import annotations

from threading import Lock
from typing import Any

from vispeg.view import html

SYSTEM, LIGHT, DARK = "as the system", "light", "dark"


class Colours:
    """Added where the page's elements are being added.

    Args:
        server: of the toolkit.
        dark: whether to begin dark, whatever the system says.
    """

    def __init__(self, server: Any, dark: bool):
        self.server, gui = server, server.gui
        self.systems: dict[int, bool] = {}  # by window: whether its system is dark
        self.lock = Lock()  # a choice and a window that speaks at the same time: the later one reads the other's word
        self.choice = gui.add_dropdown("Colours", (SYSTEM, LIGHT, DARK), initial_value=DARK if dark else SYSTEM)
        self.heard = gui.add_text("System", "")  # a window types here what its system says; it hides the field
        server.on_client_connect(self._greet)
        self.choice.on_update(lambda _: self.apply())
        self.heard.on_update(self._hear)
        self._theme(gui, dark)

    def apply(self) -> None:
        """Turn all windows to what was chosen, each by itself: a message to all may overtake one to a window."""
        with self.lock:
            for window in self.server.get_clients().values():
                self._turn(window)

    async def _greet(self, window: Any) -> None:
        """Ask a window once it can answer: words of one that is not yet connected are lost."""
        window.gui.add_html(html.window(self.heard._impl.uuid))

    async def _hear(self, event: Any) -> None:  # awaited before another window's word can take this one's place
        if event.client is None:
            return
        with self.lock:
            self.systems[event.client.client_id] = str(self.heard.value).startswith(DARK)
            self._turn(event.client)

    def _turn(self, window: Any) -> None:
        chosen = self.choice.value
        self._theme(window.gui, self.systems.get(window.client_id, False) if chosen == SYSTEM else chosen == DARK)

    @staticmethod
    def _theme(gui: Any, dark: bool) -> None:
        gui.configure_theme(show_share_button=False, show_logo=False, dark_mode=dark)
