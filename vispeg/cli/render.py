"""`vispeg render`: a dataset of pictures."""

from __future__ import annotations

from vispeg.cli.command import Call, command
from vispeg.core.interrupt import goes_on


@command("vispeg.api.datasets:render_dataset", labels=None)
@goes_on()
def render(call: Call, no_labels: bool = False) -> None:
    """Render a dataset of the expert's episodes in several looks.

    The expert plays a world's task, and its cameras render each moment in several looks. The layout is LeRobotDataset
    v3.0 or BOP. Repeat the command to continue a stopped rendering, with the same result; until it ends, the dataset is
    in OUT.unfinished. The bytes depend neither on the number of workers nor on the engine. See docs/datasets.md.

    Example:
        vispeg render --world S --frames 2000 --out frames
        vispeg render --world S --frames 2000 --looks 4 --cameras wrist_wide external --size 96 --out frames
        vispeg render --world S --frames 500 --format bop --out frames-bop
        RAY_ADDRESS=head:6379 vispeg render --world S --frames 100000 --engine ray --workers 64 --out frames

    Args:
        no_labels: draw no segmentation images (faster); poses are still written.
    """
    from vispeg.cli.progress import rendering

    with rendering(call.frames, call.output.quiet) as (begun, watch):
        result = call(labels=not no_labels, begun=begun, watch=watch)
    call.give(result)
