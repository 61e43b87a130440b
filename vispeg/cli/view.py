"""`vispeg view`: the local web page."""

from __future__ import annotations

import sys
from pathlib import Path

from vispeg.cli.command import Call, command


@command("", "sources")  # calls no function of `vispeg.api`; SOURCES is positional
def view(
    call: Call,
    sources: tuple[str, ...] = (),
    model: str | None = None,
    out: Path = Path("vispeg-view"),
    port: int | None = None,
    no_browser: bool = False,
    dark: bool = False,
    native: bool = False,
    threads: int = 2,
) -> None:
    """Open the page in the browser: diagnosis, worlds, policies, data.

    Only this machine can open the page, by the address with its token. It shows where a model fails, adds an effect
    with a click, and shows each step as an equivalent command. Results are written to OUT, from which a restarted page
    continues.

    Example:
        vispeg view rig-a rig-b rig-c
        vispeg view rig-a rig-b rig-c --model arm.urdf
        vispeg view log.csv
        vispeg view depth-S randomized
        vispeg view frames
        vispeg view runs
        vispeg view trials

    Args:
        sources: recordings, folders of them, logs, a model, a world, a policy, a dataset, a training run, or trials;
            default: an empty page.
        model: a model file, a robot's name, or a path to an MJCF or URDF; default: iiwa14.
        out: folder for what the page writes.
        port: port to listen on; default: the first free one from 8080 on.
        no_browser: do not open the browser.
        dark: dark mode, whatever the system's setting.
        native: show the model in MuJoCo's own viewer, with the effects that MuJoCo has elements for.
        threads: number of threads for the simulation.
    """
    import webbrowser

    from vispeg.core.extras import require
    from vispeg.view.opened import opened

    shown = opened(sources, model)
    if native:
        from vispeg.api.export.viewer import open_viewer

        viewer = open_viewer(shown.model)
        call.give(viewer)
        viewer.launch()
        return
    require("viser", "vispeg view")
    from vispeg.view.app import App
    from vispeg.view.gate import opener

    app = App(shown, out, port=port, threads=threads, dark=dark)
    call.output.give({"url": app.url, "out": str(out)}, [f"{app.url} (Ctrl-C ends it)"])
    sys.stdout.flush()  # a program that started this one reads the address now
    if no_browser or call.output.json:
        app.serve()
        return
    page = opener(out, app.url)
    try:
        webbrowser.open(page.resolve().as_uri())
        app.serve()
    finally:
        page.unlink(missing_ok=True)
