"""Says what this machine has, what is missing, and how to get it.

Exits 0 when recordings can be checked, fitted and diagnosed here; pictures, logs, training and videos are extras.

Example:
    vispeg doctor
    vispeg doctor --json > machine.json
"""

from __future__ import annotations

import json
import os
import platform
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path

from vispeg import __version__
from vispeg.cli.graphics import APT_LINE, has_library, probe

MIN_PYTHON, MIN_MEMORY_GB, MIN_DISK_GB = (3, 11), 4.0, 2.0
_PYPROJECT = Path(__file__).parents[2] / "pyproject.toml"  # there in a checkout, not in an installed wheel
_TORCH = """
import torch
gpus = [torch.cuda.get_device_name(i) for i in range(torch.cuda.device_count())]
print(f"torch {torch.__version__} on", ", ".join(gpus) or f"{torch.get_num_threads()} CPU threads (--device cpu)")
"""
_PHYSICS = "import mujoco; m = mujoco.MjModel.from_xml_string('<mujoco/>'); mujoco.mj_step(m, mujoco.MjData(m))"


@dataclass(frozen=True)
class Finding:
    """One line: what was looked for, whether it is there, whether the base needs it, and how to get it."""

    name: str
    ok: bool
    detail: str
    needed: bool = False
    fix: str = ""


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg doctor`."""

    json: bool = False
    """Print JSON instead of a table."""

    def run(self) -> int:
        """Prints the findings; 0 if nothing that the base needs is missing, else 1."""
        findings = examine()
        healthy = all(f.ok for f in findings if f.needed)
        if self.json:
            record = {"format": "vispeg-doctor/1", "ok": healthy, "findings": [asdict(f) for f in findings]}
            print(json.dumps(record, indent=2))
            return 0 if healthy else 1
        width = max(len(f.name) for f in findings)
        for f in findings:
            mark = "ok  " if f.ok else ("FAIL" if f.needed else "none")
            print(f"{mark}  {f.name:<{width}}  {f.detail}")
            if not f.ok and f.fix:
                print(f"{'':<{width + 8}}-> {f.fix}")
        print("\nReady." if healthy else "\nNot ready: put right what is marked FAIL.")
        return 0 if healthy else 1


def examine() -> list[Finding]:
    """All findings about this machine, the needed ones first."""
    return [_python(), *_packages(), _physics(), _memory(), _disk(), _torch(), *_pictures(), _gpu(), _ffmpeg()]


def _python() -> Finding:
    have, least = platform.python_version(), ".".join(map(str, MIN_PYTHON))
    where = f"vispeg {__version__}, Python {have}, {platform.system()} {platform.machine()}"
    return Finding("python", sys.version_info >= MIN_PYTHON, where, True, f"install Python {least} or newer")


def _packages() -> Iterator[Finding]:
    """One finding for the base's packages and one for each extra, against the versions this release was made for."""
    from packaging.requirements import Requirement

    groups: dict[str, list[str]] = {"": []}
    for text in _requirements():
        requirement = Requirement(text)
        extra = re.search(r"extra == ['\"]([\w-]+)['\"]", str(requirement.marker or ""))
        name = extra[1] if extra else ""
        if requirement.marker and not requirement.marker.evaluate({"extra": name}):
            continue
        wrong = groups.setdefault(name, [])
        try:
            have = metadata.version(requirement.name)
        except metadata.PackageNotFoundError:
            wrong.append(f"{requirement.name} is not installed")
            continue
        if not requirement.specifier.contains(have, prereleases=True):
            wrong.append(f"{requirement.name} {have}, needed {requirement.specifier}")
    this = "-e " if _PYPROJECT.is_file() else ""  # a checkout is installed from where it stands
    base = "." if this else "vispeg"
    for name, wrong in groups.items():
        label, target = (f"extra '{name}'", f"'{base}[{name}]'") if name else ("packages", base)
        yield Finding(label, not wrong, "; ".join(wrong) or "all here", not name, f"pip install {this}{target}")


def _requirements() -> list[str]:
    """What this release asks for; a checkout's own word counts, as its installation may be older than itself."""
    if _PYPROJECT.is_file():
        import tomllib

        project = tomllib.loads(_PYPROJECT.read_text(encoding="utf-8"))["project"]
        extras = project["optional-dependencies"].items()
        return project["dependencies"] + [f"{text}; extra == '{name}'" for name, texts in extras for text in texts]
    try:
        return metadata.requires("vispeg") or []
    except metadata.PackageNotFoundError:
        return []


def _physics() -> Finding:
    environment = {**os.environ, "MUJOCO_GL": "disabled"}
    done = subprocess.run([sys.executable, "-c", _PHYSICS], env=environment, capture_output=True, text=True)
    detail = "MuJoCo steps" if done.returncode == 0 else (done.stderr.strip().splitlines() or ["no answer"])[-1]
    return Finding("physics", done.returncode == 0, detail, True, "pip install --force-reinstall 'mujoco>=4.0,<4.1'")


def _memory() -> Finding:
    gigabytes = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9
    limit = Path("/sys/fs/cgroup/memory.max")  # a container's share may be smaller than the machine
    if limit.is_file() and (text := limit.read_text().strip()).isdigit():
        gigabytes = min(gigabytes, int(text) / 1e9)
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    fix = f"{MIN_MEMORY_GB:.0f} GB are enough for every command but training"
    return Finding("cores, memory", gigabytes >= MIN_MEMORY_GB, f"{cores} cores, {gigabytes:.1f} GB", fix=fix)


def _disk() -> Finding:
    free = shutil.disk_usage(Path.cwd()).free / 1e9
    return Finding("disk", free >= MIN_DISK_GB, f"{free:.1f} GB free here", fix=f"free {MIN_DISK_GB:.0f} GB")


def _torch() -> Finding:
    """Whether networks can be trained here, and on what; torch itself is imported in another process."""
    target = "'.[learn]'" if _PYPROJECT.is_file() else "'vispeg[learn]'"
    fix = f"pip install {'-e ' if _PYPROJECT.is_file() else ''}{target}; without it everything but policies works"
    try:
        metadata.version("torch")
    except metadata.PackageNotFoundError:
        return Finding("training (torch)", False, "not installed, so no policies are trained or played", fix=fix)
    done = subprocess.run([sys.executable, "-c", _TORCH], capture_output=True, text=True)
    detail = (done.stdout if done.returncode == 0 else done.stderr).strip().splitlines() or ["no answer"]
    return Finding("training (torch)", done.returncode == 0, detail[-1], fix=fix)


def _pictures() -> Iterator[Finding]:
    """The renderers that need OpenGL, what is used where there is none, and the one that needs Vulkan."""
    egl = probe("egl")
    yield Finding("pictures (egl)", egl.ok, egl.detail, fix=APT_LINE)
    osmesa = probe("osmesa")
    fix = "sudo apt-get install -y libosmesa6, then MUJOCO_GL=osmesa" + ("; not needed where EGL draws" * egl.ok)
    yield Finding("pictures (osmesa)", osmesa.ok, osmesa.detail, fix=fix)
    use = "works everywhere; plain colours, no textures" + ("" if egl.ok or osmesa.ok else ": what is used here")
    yield Finding("pictures (raycast)", True, use)
    yield _vulkan()


def _gpu() -> Finding:
    fix = "not needed; speeds up rendering and training (NVIDIA driver and nvidia-smi)"
    if (tool := shutil.which("nvidia-smi")) is None:
        return Finding("gpu", False, "no nvidia-smi", fix=fix)
    query = [tool, "--query-gpu=name,memory.total", "--format=csv,noheader"]
    try:
        done = subprocess.run(query, capture_output=True, text=True, timeout=30)
    except (subprocess.TimeoutExpired, OSError):
        return Finding("gpu", False, "nvidia-smi does not answer", fix=fix)
    return Finding("gpu", done.returncode == 0, "; ".join(done.stdout.splitlines()) or "nvidia-smi failed", fix=fix)


def _vulkan() -> Finding:
    fix = "sudo apt-get install -y libvulkan1 mesa-vulkan-drivers"
    name = "pictures (filament)"
    folders = (Path("/usr/share/vulkan/icd.d"), Path("/etc/vulkan/icd.d"))
    drivers = sorted(file.stem for folder in folders if folder.is_dir() for file in folder.glob("*.json"))
    if not drivers or not has_library("libvulkan.so.1"):
        return Finding(name, False, "no Vulkan driver, so no physically based pictures", fix=fix)
    from vispeg.render.filament import unusable

    reason = unusable()
    return Finding(name, not reason, reason or f"Vulkan draws ({len(drivers)} drivers installed)", fix=fix)


def _ffmpeg() -> Finding:
    from vispeg.evaluate.video import ffmpeg

    path = ffmpeg()
    if path is None:
        return Finding("ffmpeg", False, "no ffmpeg, so no videos", fix="sudo apt-get install -y ffmpeg")
    return Finding("ffmpeg", True, Path(path).name)
