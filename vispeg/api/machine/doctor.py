"""Check what this machine has, what is missing, and how to get it."""

from __future__ import annotations

import os
import platform
import shutil
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from html import escape
from importlib import metadata
from pathlib import Path

from vispeg import __version__
from vispeg.api.machine.graphics import APT_LINE, has_library, probe
from vispeg.api.machine.installed import BASE, EDITABLE, wrong_packages
from vispeg.core.broken import meaning, run

MIN_PYTHON, MIN_MEMORY_GB, MIN_DISK_GB = (3, 11), 4.0, 2.0
_INSTALL = f"pip install --force-reinstall {EDITABLE}{BASE}"
_TORCH = """
import torch
gpus = [torch.cuda.get_device_name(i) for i in range(torch.cuda.device_count())]
print(f"torch {torch.__version__} on", ", ".join(gpus) or f"{torch.get_num_threads()} CPU threads (--device cpu)")
"""
_FILAMENT = "from vispeg.render.backends.filament import unusable; print('.' + unusable())"
_VIDEO = "from vispeg.evaluation.films.video import ffmpeg; print(ffmpeg() or '')"
_PHYSICS = "import mujoco; m = mujoco.MjModel.from_xml_string('<mujoco/>'); mujoco.mj_step(m, mujoco.MjData(m))"


@dataclass(frozen=True)
class Finding:
    """A line of the report: what was checked, whether it is fine, details, whether the base needs it, and a remedy."""

    name: str
    ok: bool
    detail: str
    needed: bool = False
    fix: str = ""


@dataclass(frozen=True)
class Machine:
    """The findings on a machine.

    Attributes:
        findings: the findings, needed things first.
    """

    findings: Sequence[Finding]

    @property
    def healthy(self) -> bool:
        """Whether nothing that the base needs is missing."""
        return all(f.ok for f in self.findings if f.needed)

    @property
    def record(self) -> dict[str, object]:
        """The output of `vispeg doctor --json`."""
        return {"format": "vispeg-doctor/1", "ok": self.healthy, "findings": [asdict(f) for f in self.findings]}

    def text(self, missing: bool = False) -> str:
        """Return a line per finding with remedies for what is missing; with `missing`, only what is missing."""
        width = max(len(f.name) for f in self.findings)
        lines = []
        for f in (f for f in self.findings if not (missing and f.ok)):
            lines.append(f"{'ok  ' if f.ok else 'FAIL' if f.needed else 'none'}  {f.name:<{width}}  {f.detail}")
            lines += [f"{'':<{width + 8}}-> {f.fix}"] if not f.ok and f.fix else []
        if not (missing and self.healthy):
            lines += ["", "Ready." if self.healthy else "Not ready: fix what is marked FAIL."]
        return "\n".join(lines)

    __str__ = text

    def _repr_html_(self) -> str:
        return f"<pre>{escape(self.text())}</pre>"


def examine() -> Machine:
    """Examine this machine, as `vispeg doctor` does; an examination that fails is reported as a finding."""
    parts = {"python": _python, "packages": _packages, "physics": _physics, "cores, memory": _memory, "disk": _disk}
    parts |= {"training (torch)": _torch, "pictures": _pictures, "gpu": _gpu, "ffmpeg": _ffmpeg}
    return Machine([finding for name, look in parts.items() for finding in _look(name, look)])


def _look(name: str, look: Callable[[], Finding | Iterable[Finding]]) -> list[Finding]:
    try:
        findings = look()
        return [findings] if isinstance(findings, Finding) else list(findings)
    except Exception as error:  # a broken installation may raise anything; users get a short reason
        needed = name in ("python", "packages", "physics")
        return [Finding(name, False, f"cannot be examined: {meaning(error)}", needed, _INSTALL)]


def _python() -> Finding:
    have, least = platform.python_version(), ".".join(map(str, MIN_PYTHON))
    where = f"vispeg {__version__}, Python {have}, {platform.system()} {platform.machine()}"
    return Finding("python", sys.version_info >= MIN_PYTHON, where, True, f"install Python {least} or newer")


def _packages() -> Iterator[Finding]:
    """Yield a finding on the base's packages and one on each extra, by the versions that this release requires."""
    for name, wrong in wrong_packages().items():
        target = f"'{BASE}[{name}]'" if name else BASE
        again = "--force-reinstall " * any(w.broken for w in wrong)
        label, fix = f"extra '{name}'" if name else "packages", f"pip install {again}{EDITABLE}{target}"
        yield Finding(label, not wrong, "; ".join(w.said for w in wrong) or "all here", not name, fix)


def _physics() -> Finding:
    command, fix = [sys.executable, "-c", _PHYSICS], "pip install --force-reinstall 'mujoco>=4.0,<4.1'"
    ok, output = run(command, {**os.environ, "MUJOCO_GL": "disabled"})
    if not ok:
        return Finding("physics", False, output, True, fix)
    chosen = os.environ.get("MUJOCO_GL")
    ok, output = run(command) if chosen else (True, "")
    if not ok:
        return Finding(
            "physics", False, f"MuJoCo does not start with MUJOCO_GL={chosen}: {output}", True, "unset MUJOCO_GL"
        )
    return Finding("physics", True, "MuJoCo steps", True)


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
    """Return whether networks can be trained here, and on which devices; torch is imported in another process."""
    fix = f"pip install {EDITABLE}'{BASE}[learn]'; without it everything but policies works"
    try:
        metadata.version("torch")
    except metadata.PackageNotFoundError:
        return Finding("training (torch)", False, "not installed, so no policies are trained or played", fix=fix)
    ok, output = run([sys.executable, "-c", _TORCH], timeout=120.0)
    return Finding("training (torch)", ok, output, fix=fix)


def _pictures() -> Iterator[Finding]:
    """Yield findings on the renderers: two that need OpenGL, the ray caster, and one that needs Vulkan."""
    egl = probe("egl")
    yield Finding("pictures (egl)", egl.ok, egl.detail, fix=APT_LINE)
    osmesa = probe("osmesa")
    fix = "sudo apt-get install -y libosmesa6, then MUJOCO_GL=osmesa" + ("; not needed where EGL draws" * egl.ok)
    yield Finding("pictures (osmesa)", osmesa.ok, osmesa.detail, fix=fix)
    use = "works everywhere; no shadows, no highlights" + ("" if egl.ok or osmesa.ok else ": what is used here")
    yield Finding("pictures (raycast)", True, use)
    yield _vulkan()


def _gpu() -> Finding:
    fix = "not needed; speeds up rendering and training (NVIDIA driver and nvidia-smi)"
    if (tool := shutil.which("nvidia-smi")) is None:
        return Finding("gpu", False, "no nvidia-smi", fix=fix)
    query = [tool, "--query-gpu=name,memory.total", "--format=csv,noheader"]
    ok, output = run(query, timeout=30.0)
    return Finding("gpu", ok, output if ok else f"nvidia-smi: {output}", fix=fix)


def _vulkan() -> Finding:
    fix = "sudo apt-get install -y libvulkan1 mesa-vulkan-drivers"
    name = "pictures (filament)"
    folders = (Path("/usr/share/vulkan/icd.d"), Path("/etc/vulkan/icd.d"))
    drivers = sorted(file.stem for folder in folders if folder.is_dir() for file in folder.glob("*.json"))
    if not drivers or not has_library("libvulkan.so.1"):
        return Finding(name, False, "no Vulkan driver, so no physically based pictures", fix=fix)
    ok, output = run([sys.executable, "-c", _FILAMENT], {**os.environ, "MUJOCO_GL": "disabled"}, 90.0)
    reason = output.removeprefix(".") if ok else output
    return Finding(name, not reason, reason or f"Vulkan draws ({len(drivers)} drivers installed)", fix=fix)


def _ffmpeg() -> Finding:
    ok, output = run([sys.executable, "-c", _VIDEO], {**os.environ, "MUJOCO_GL": "disabled"})
    if ok and output:
        return Finding("ffmpeg", True, Path(output).name)
    return Finding("ffmpeg", False, output or "no ffmpeg, so no videos", fix="sudo apt-get install -y ffmpeg")
