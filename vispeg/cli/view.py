"""Opens the page in the browser: diagnosis, worlds, policies, data.

The page is served on this machine alone, to whoever has the address with its token. It shows where a model fails, adds
an effect by a click, and shows each step as the command that does the same. Results are written to OUT; a stopped page
goes on from there.

Example:
    vispeg view rig-a rig-b rig-c
    vispeg view rig-a rig-b rig-c --model arm.urdf
    vispeg view log.csv
    vispeg view depth-S randomized
    vispeg view frames
    vispeg view runs
    vispeg view trials
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
    """Recordings, folders of them, logs, a model, a world, a policy, a dataset, a training run, or trials;
    default: an empty page."""
    model: str | None = None
    """A model file, a robot's name, or a path to an MJCF or URDF; default: iiwa14."""
    out: Path = Path("vispeg-view")
    """Folder for what the page writes."""
    port: int | None = None
    """Port; default: the first free one from 8080 on."""
    no_browser: bool = False
    """Do not open the browser."""
    dark: bool = False
    """Dark mode, whatever the system's setting."""
    native: bool = False
    """Show the model in MuJoCo's own viewer, with the effects that MuJoCo has elements for."""
    threads: int = 2
    """Threads of the simulation."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Serve the page until it is interrupted."""
        import sys
        import webbrowser

        from vispeg.core.extras import require
        from vispeg.view.opened import opened

        sources = opened(self.sources, self.model)
        if self.native:
            return self._native(sources.model)
        require("viser", "vispeg view")
        from vispeg.view.app import App
        from vispeg.view.gate import opener

        app = App(sources, self.out, port=self.port, threads=self.threads, dark=self.dark)
        self.output.give({"url": app.url, "out": str(self.out)}, [f"{app.url} (Ctrl-C ends it)"])
        sys.stdout.flush()  # a program that started this one reads the address now
        if self.no_browser or self.output.json:
            app.serve()
            return 0
        way = opener(self.out, app.url)
        try:
            webbrowser.open(way.resolve().as_uri())
            app.serve()
        finally:
            way.unlink(missing_ok=True)
        return 0

    def _native(self, model: str) -> int:
        """MuJoCo's own viewer; it needs a display."""
        from vispeg.api.export.viewer import open_viewer

        viewer = open_viewer(model)
        self.output.give(viewer.record, viewer.summary)
        viewer.launch()
        return 0
