"""Robots by name from MuJoCo Menagerie: from a checkout in MENAGERIE_ROOT, else by the package `mujoco-menagerie`.

The package downloads a robot at its first use and keeps it. If an arm comes with and without a hand, its short name
means the one without.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from vispeg.core.errors import UserError
from vispeg.core.extras import install

ARMS = {  # short name: FOLDER/ENTRY, and the usual name
    "fr3": ("franka_fr3/fr3", "Franka Research 3"),
    "gen3": ("kinova_gen3/gen3", "Kinova Gen3, 7 joints"),
    "lite6": ("ufactory_lite6/lite6", "UFACTORY Lite 6"),
    "panda": ("franka_emika_panda/panda_nohand", "Franka Emika Panda, without its hand"),
    "piper": ("agilex_piper/piper", "AgileX PiPER, with its gripper"),
    "rizon4": ("flexiv_rizon4/flexiv_rizon4", "Flexiv Rizon 4"),
    "sawyer": ("rethink_robotics_sawyer/sawyer", "Rethink Robotics Sawyer"),
    "so100": ("trs_so_arm100/so_arm100", "Standard Open Arm 100, with its gripper"),
    "so101": ("robotstudio_so101/so101", "Standard Open Arm 101, with its gripper"),
    "ur10e": ("universal_robots_ur10e/ur10e", "Universal Robots UR10e"),
    "ur5e": ("universal_robots_ur5e/ur5e", "Universal Robots UR5e"),
    "vx300s": ("trossen_vx300s/vx300s", "Trossen ViperX 300 6DOF, with its gripper (ALOHA's)"),
    "wx250s": ("trossen_wx250s/wx250s", "Trossen WidowX 250 6DOF, with its gripper"),
    "xarm7": ("ufactory_xarm7/xarm7_nohand", "UFACTORY xArm 7, without its hand"),
    "z1": ("unitree_z1/z1", "Unitree Z1, without its gripper"),
}
SHORT = {name: entry for name, (entry, _) in ARMS.items()}
HERE, DOWNLOADS, ABSENT = "here", "downloads", "not here"
HOW = f"{install('menagerie')}, MENAGERIE_ROOT set to a checkout of it, or a path to an .xml (MJCF) or .urdf"


def folders() -> dict[str, Path]:
    """Return the robots of the checkout in MENAGERIE_ROOT: path by folder name. Empty without a checkout."""
    root = os.environ.get("MENAGERIE_ROOT")
    if not root or not Path(root).is_dir():
        return {}
    return {p.name: p for p in Path(root).iterdir() if p.is_dir() and _files(p)}


def _files(folder: Path) -> list[Path]:
    """Return the robots' MJCF in a folder; scenes around a robot are left out."""
    return sorted(p for p in folder.glob("*.xml") if not p.stem.startswith("scene"))


def available() -> list[str]:
    """Return the names that `find` can resolve without a download, short ones first."""
    there = folders()
    return [*(s for s, full in SHORT.items() if full.partition("/")[0] in there), *sorted(there)]


def knows(robot: str) -> bool:
    """Return whether Menagerie has a robot of that name, on this computer or for download."""
    if robot in SHORT:  # a search asks this for every world, so avoid disk access
        return True
    folder, package = robot.partition("/")[0], _package()
    return (
        folder in folders()
        or folder in {full.partition("/")[0] for full in SHORT.values()}
        or (package is not None and folder in package.names())
    )


def state(robot: str) -> str:
    """Return the state of an arm of ARMS: HERE, DOWNLOADS (it will be downloaded at its first use) or ABSENT."""
    folder, package = SHORT[robot].partition("/")[0], _package()
    if folder in folders():
        return HERE
    if package is None:
        return ABSENT
    return HERE if package.Cache().is_cached(package.get(folder)) else DOWNLOADS


def find(robot: str) -> Path | None:
    """Return the file of a robot, named by short name, folder or FOLDER/ENTRY; None for an unknown name.

    Raises:
        UserError: the robot is known but not available here, its download failed, or its folder lacks the entry.
    """
    folder, _, entry = SHORT.get(robot, robot).partition("/")
    there = folders()
    if folder in there:
        return _entry(there[folder], entry)
    path = _downloaded(folder)
    if path is not None:
        return _entry(path, entry)
    if not knows(robot):
        return None
    if root := os.environ.get("MENAGERIE_ROOT"):
        expected = "a checkout with it, or no MENAGERIE_ROOT, so that it is downloaded"
        raise UserError(f"the robot '{robot}' is not in MENAGERIE_ROOT ({root})", expected=expected)
    what = f"the robot '{robot}' is not here; it is an arm of the extra 'menagerie' (MuJoCo Menagerie)"
    raise UserError(what, expected=HOW)


def _entry(folder: Path, entry: str) -> Path:
    """Return a folder's MJCF named `entry`; for "" the one whose name ends the folder's name, else the first."""
    files = _files(folder)
    if entry:
        named = [p for p in files if p.stem == entry]
        if not named:
            raise UserError("no such entry of this robot", file=folder, got=entry, choices=[p.stem for p in files])
        return named[0]
    plain = folder.name.replace("_", "")
    best = [p for p in files if plain.endswith(p.stem.replace("_", ""))]  # kuka_iiwa_14/iiwa14.xml
    return (best or files)[0]


def _package() -> Any:
    """Return the package `mujoco-menagerie`, for downloads; None if it is not installed, or a checkout replaces it."""
    if os.environ.get("MENAGERIE_ROOT"):
        return None
    try:
        import mujoco_menagerie
    except ImportError:
        return None
    return mujoco_menagerie


def _downloaded(folder: str) -> Path | None:
    """Return the folder of a robot from the package `mujoco-menagerie`, downloaded if needed.

    None without the package, or if it does not have the robot.

    Raises:
        UserError: the download failed.
    """
    package = _package()
    if package is None or folder not in package.names():
        return None
    try:
        return Path(package.get(folder).path())
    except (package.MenagerieError, OSError) as error:
        what = f"mujoco-menagerie cannot get the robot '{folder}': {error}"
        raise UserError(what, expected="a connection, or MENAGERIE_ROOT set to a checkout") from None
