"""Opens a page in the browser: see where a model fails, add an effect by a click, watch the error fall.

The page is served on this machine alone. It shows each step also as the command that does the same. Results are written
to OUT, so that a page that was stopped goes on from there.

Example:
    vispeg view rig-a rig-b rig-c
    vispeg view rig-a rig-b rig-c --model arm.urdf
    vispeg view log.csv
    vispeg view depth-S randomized
    vispeg view frames
    vispeg view runs
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from vispeg.cli.output import Output, OutputOptions


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg view`."""

    sources: tyro.conf.Positional[tuple[str, ...]] = ()
    """Recordings, folders of them, logs, a model, a world, a policy, a dataset, or a training run; none opens an empty
    page."""
    model: str | None = None
    """A model file, a robot's name, or a path to an MJCF or URDF; iiwa14 where none is named."""
    out: Path = Path("vispeg-view")
    """Folder for what the page writes."""
    port: int = 8080
    """Port to listen at; the next free one where it is taken."""
    browser: bool = True
    """Open the browser."""
    dark: bool = False
    """Dark mode, whatever the system's setting."""
    native: bool = False
    """Show the model, with the effects that MuJoCo has elements for, in MuJoCo's own viewer instead."""
    threads: int = 2
    """Threads of the simulation."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Serves the page until it is interrupted."""
        import sys
        import webbrowser

        from vispeg.core.extras import require
        from vispeg.view.opened import opened

        sources = opened(self.sources, self.model)
        if self.native:
            return self._native(sources.model)
        require("viser", "vispeg view")
        from vispeg.view.app import App

        app = App(sources, self.out, port=self.port, threads=self.threads, dark=self.dark)
        self.output.give({"url": app.url, "out": str(self.out)}, [f"{app.url} (Ctrl-C ends it)"])
        sys.stdout.flush()  # a program that started this one reads the address now
        if self.browser and not self.output.json:
            webbrowser.open(app.url)
        app.serve()
        return 0

    def _native(self, model: str) -> int:
        """MuJoCo's own viewer; it needs a display."""
        from vispeg.api.export.viewer import open_viewer

        viewer = open_viewer(model)
        self.output.give(viewer.record, viewer.summary)
        viewer.launch()
        return 0
