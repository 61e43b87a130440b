"""Camera pictures on the page: the recorded one, the one that the model renders, and a slider that blends them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from vispeg.view.diagnose.standing import Pictured, Standing
from vispeg.view.place import Place

LEAST = 320  # px; smaller pictures are enlarged to about this width
KINDS = {"colour": ("rendered", "measured"), "depth": ("depth_rendered", "depth_measured")}


class Pictures:
    """Add the elements to the part of the page that is being built; show them if the recordings have pictures.

    Args:
        place: what all pages share: server, folder of results, 3D view.
        ask: called with a camera's name to request its picture at the shown moment.
    """

    def __init__(self, place: Place, ask: Callable[[str], None]):
        gui = place.gui
        self.place, self.taken = place, None
        self.folder = gui.add_folder("Cameras", visible=False)
        with self.folder:
            self.camera = gui.add_dropdown("Camera", ("camera",))
            self.kind = gui.add_dropdown("Picture", tuple(KINDS))
            self.see = gui.add_button("Show the picture at this moment")
            self.share = gui.add_slider("Measured to rendered", 0.0, 1.0, 0.01, 0.0)
            self.images = gui.add_folder(None)
        self.image: Any = None
        self.see.on_click(lambda _: ask(str(self.camera.value)))
        self.share.on_update(lambda _: self.draw())
        self.kind.on_update(lambda _: self.draw())

    def take(self, standing: Standing) -> None:
        """Offer the cameras of the recordings that are compared."""
        names = tuple(dict.fromkeys(name for track in standing.tracks for name in track.cameras))
        self.folder.visible = bool(names)
        if names and tuple(self.camera.options) != names:
            self.camera.options = names

    def show(self, taken: Pictured) -> None:
        """Show a frame."""
        self.taken = taken
        kinds = tuple(kind for kind, (picture, _) in KINDS.items() if picture in taken.pictures)
        if kinds and tuple(self.kind.options) != kinds:
            self.kind.options = kinds
        self.draw()

    def draw(self) -> None:
        """Draw the frame, blended from measured (0) to rendered (1) as the slider says."""
        if self.taken is None or str(self.kind.value) not in KINDS:
            return
        rendered, measured = (self.taken.pictures.get(name) for name in KINDS[str(self.kind.value)])
        if rendered is None or measured is None:
            return
        share = float(self.share.value)
        mixed = np.round((1 - share) * measured.astype(float) + share * rendered.astype(float)).astype(np.uint8)
        times = max(1, round(LEAST / mixed.shape[1]))
        large = mixed.repeat(times, axis=0).repeat(times, axis=1)
        if self.image is None:
            with self.images:
                self.image = self.place.gui.add_image(large, label=self._label(), format="jpeg")
        else:
            self.image.image, self.image.label = large, self._label()

    def _label(self) -> str:
        return "" if self.taken is None else f"{self.taken.camera} at {self.taken.time:.2f} s"
