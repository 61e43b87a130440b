"""The cases: every effect at two sizes, pairs, none, and faults that no effect of the library is."""

from __future__ import annotations

from dataclasses import dataclass
from fnmatch import fnmatch

CAMERA = "wrist_wide"
SINGLE: dict[str, tuple[dict[str, float], dict[str, float]]] = {
    "camera_offset": ({"x": 0.002, "rz": 0.005}, {"x": -0.004, "y": 0.003, "ry": 0.012}),
    "focal_error": ({"fx": 0.008, "fy": 0.008}, {"fx": -0.025, "fy": -0.025}),
    "principal_point_error": ({"x": 1.2, "y": -0.8}, {"x": -4.0, "y": 2.5}),
    "lens_distortion": ({"k1": -0.02}, {"k1": 0.06, "k2": -0.01}),
    "camera_delay": ({"delay": 0.015}, {"delay": 0.05}),
    "rolling_shutter": ({"readout": 0.015}, {"readout": 0.035}),
    "depth_scale": ({"factor": 1.01}, {"factor": 0.97}),
    "depth_bias": ({"tilt_x": 0.002}, {"tilt_x": -0.004, "tilt_y": 0.004}),
    "depth_noise": ({"sigma0": 0.0008, "k": 0.002}, {"sigma0": 0.002, "k": 0.006}),
    "depth_dropout": ({"share": 0.03}, {"share": 0.12}),
    "edge_fattening": ({"window": 7.0}, {"window": 15.0}),
    "exposure": ({"stops": 0.7}, {"stops": -1.5}),
    "white_balance": ({"red": 1.2, "blue": 0.85}, {"red": 0.7, "blue": 1.4}),
    "vignetting": ({"amount": 0.6}, {"amount": 1.2}),
    "blur": ({"sigma": 0.8}, {"sigma": 1.6}),
    "motion_blur": ({"exposure": 0.02}, {"exposure": 0.05}),
    "rgb_noise": ({"shot": 0.001, "read": 0.01}, {"shot": 0.004, "read": 0.03}),
}
ENCODERS = (("joint4", 0.006), ("joint6", 0.012), ("joint7", 0.01), ("joint2", 0.004))
PAIRS = (
    ("camera_offset", "focal_error"),
    ("focal_error", "camera_delay"),
    ("camera_offset", "lens_distortion"),
    ("principal_point_error", "camera_offset"),
    ("camera_delay", "camera_offset"),
    ("focal_error", "lens_distortion"),
)
UNKNOWN = ("bent_flange", "tilted_fixture", "moved_fixture", "water_on_lens", "bent_board")
# the motion that a diagnosis proposes under `not_excited` for effects for which the ordinary motion is too slow
MOTIONS = {"motion_blur": "look-fast", "rolling_shutter": "look-fast"}
MOVES = ("camera_offset", "focal_error", "principal_point_error", "lens_distortion", "camera_delay", "rolling_shutter")


@dataclass(frozen=True)
class Case:
    """One recording pair. `kind`: single, pair, none, unknown; `hidden`: (effect, where, values)."""

    name: str
    kind: str
    hidden: tuple[tuple[str, str, tuple[tuple[str, float], ...]], ...]
    unknown: str
    robot: float  # m, 1 sigma of the flange's position error
    seed: int

    @property
    def motion(self) -> str:
        """Name of the recorded motion."""
        return next((MOTIONS[e] for e, _, _ in self.hidden if e in MOTIONS), "look")


def cases(first: int) -> list[Case]:
    """Return all cases, numbered from the seed `first`; another seed gives other looks, errors and noise."""
    out: list[Case] = []

    def add(name: str, kind: str, hidden=(), unknown: str = "") -> None:
        robot = (1e-4, 1e-3)[len(out) % 2]  # in turn
        out.append(Case(f"{name}/{1000 * robot:g}mm", kind, tuple(hidden), unknown, robot, first + len(out)))

    for effect, sizes in SINGLE.items():
        for k, values in enumerate(sizes):
            for repeat in range(2 if effect in MOVES and not k else 1):
                add(f"{effect}/{('small', 'large')[k]}{repeat or ''}", "single", [(effect, CAMERA, _items(values))])
    for joint, offset in ENCODERS:
        add(f"encoder_offset/{joint}", "single", [("encoder_offset", joint, (("offset", offset),))])
    for k, (one, other) in enumerate(PAIRS):
        large = [(e, CAMERA, _items(SINGLE[e][1])) for e in (one, other)]
        add(f"pair/{one}+{other}", "pair", large)
        add(f"pair/{one}+{other}/{k}", "pair", [large[0], (other, CAMERA, _items(SINGLE[other][0]))])
    for k in range(20):
        add(f"none/{k}", "none")
    for name in UNKNOWN:
        for k in range(3):
            add(f"{name}/{k}", "unknown", unknown=name)
    return out


def choose(only: list[str], first: int, limit: int | None) -> list[Case]:
    """Return the cases that match these patterns, at most `limit` of them, evenly spread over the list."""
    found = [c for c in cases(first) if not only or any(fnmatch(c.name, p) for p in only)]
    if limit is None or limit >= len(found):
        return found
    return [found[int((i + 0.5) * len(found) / limit)] for i in range(limit)]


def _items(values: dict[str, float]) -> tuple[tuple[str, float], ...]:
    return tuple(values.items())
