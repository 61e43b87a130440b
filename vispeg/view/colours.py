"""Light or dark: as each window's system has it, until somebody chooses."""

from __future__ import annotations

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
        self.choice = gui.add_dropdown("Colours", (SYSTEM, LIGHT, DARK), initial_value=DARK if dark else SYSTEM)
        self.heard = gui.add_text("System", "")  # a window types here what its system says; it hides the field
        gui.add_html(html.window(self.heard._impl.uuid))
        self.choice.on_update(lambda _: self.apply())
        self.heard.on_update(self._hear)
        self._theme(gui, dark)

    def apply(self) -> None:
        """Turns all windows to what was chosen."""
        self._theme(self.server.gui, self.choice.value == DARK)
        if self.choice.value == SYSTEM:
            for window in self.server.get_clients().values():
                self._theme(window.gui, self.systems.get(window.client_id, False))

    def _hear(self, event: Any) -> None:
        if event.client is None:
            return
        self.systems[event.client.client_id] = str(self.heard.value).startswith(DARK)
        if self.choice.value == SYSTEM:
            self._theme(event.client.gui, self.systems[event.client.client_id])

    @staticmethod
    def _theme(gui: Any, dark: bool) -> None:
        gui.configure_theme(show_share_button=False, show_logo=False, dark_mode=dark)
