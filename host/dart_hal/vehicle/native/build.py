"""Compiler and library files of the kernels: find, compile, keep.

Only the standard library, because the build of the package runs it before
anything is installed. A library is called by a hash of its source, its number
type and the processor it was compiled for: another equation or another machine
never meets an old one. The compiler's version has no part in that, so that a
library is found where the compiler is gone; each one is checked against the
Python equations before its first use anyway.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

HERE = Path(__file__).resolve().parent
# The kernels of the shipped parameter sets, generated.
COMMITTED = HERE / "kernel.c"
# Libraries that the build of the package made of it.
BUILT = HERE / "_built"

COMPILE_OPTIONS = ("-std=gnu11", "-O3", "-ffast-math", "-fopenmp-simd", "-fPIC")
# Every operation rounded once and in the order of the equations, as Python computes.
EXACT_OPTIONS = ("-std=gnu11", "-O2", "-ffp-contract=off", "-fPIC")
# What makes a compiler use the vectors of this processor, all of their width (gcc takes half,
# which costs a third of the speed); the first that the compiler knows.
MACHINE_OPTIONS: tuple[tuple[str, ...], ...] = (
    ("-march=native", "-mprefer-vector-width=512"), ("-march=native",), ("-mcpu=native",), ())
# glibc's vector sin, tanh and so on, where there are any; -lm is always linked.
VECTOR_MATH: tuple[tuple[str, ...], ...] = (("-lmvec",), ())
# A portable library runs on every processor of its architecture, half as fast.
PORTABLE_OPTIONS: tuple[tuple[str, ...], ...] = ((),)
TIMEOUT_S = 120.0
# Libraries in the user's cache, each about 30 kB. A diagnosis that finds ten causes needs about
# 150: one for each effect on forces, combined with the causes found before.
MAX_CACHED_LIBRARIES = 1000


class Variant(NamedTuple):
    """bits 32 or 64 of a number; lanes: each car its own parameters; exact: to the last bit."""

    bits: int
    lanes: bool
    exact: bool = False

    @property
    def options(self) -> tuple[str, ...]:
        """Arguments for the compiler."""
        return (*(EXACT_OPTIONS if self.exact else COMPILE_OPTIONS), f"-DBITS={self.bits}",
                f"-DLANES={int(self.lanes)}", f"-DEXACT={int(self.exact)}")


# Of the kernels that are built with the package.
VARIANTS = tuple(Variant(bits, lanes) for bits in (64, 32) for lanes in (False, True))


class CannotCompile(RuntimeError):
    """There is no C compiler, or it failed; the message has the reason."""


def compiler() -> list[str] | None:
    """The C compiler as a command: $CC, cc, gcc or clang; None without one."""
    given = os.environ.get("CC", "").strip()
    if given:
        # The path of a compiler may contain spaces; a command may have options.
        command = [given] if shutil.which(given) else shlex.split(given)
        return command if shutil.which(command[0]) else None
    return next(([name] for name in ("cc", "gcc", "clang") if shutil.which(name)), None)


def key(source: str, variant: Variant, *, portable: bool = False) -> str:
    """Name of a library without suffix."""
    machine = (platform.machine(),) if portable else (*sum(MACHINE_OPTIONS, ()), processor())
    parts = (source, *variant.options, *machine)
    digest = hashlib.sha256("\0".join(parts).encode()).hexdigest()[:16]
    marks = {"-lanes": variant.lanes, "-exact": variant.exact, "-portable": portable}
    kind = "".join(mark for mark, is_set in marks.items() if is_set)
    return f"kernel-f{variant.bits}{kind}-{digest}"


@lru_cache(maxsize=1)
def processor() -> str:
    """What -march=native depends on: the processor's model and what it can do."""
    listing = Path("/proc/cpuinfo")
    fields = ("model name", "flags", "Features", "CPU part", "CPU implementer")
    facts = [platform.system(), platform.machine()]
    if sys.platform == "linux" and listing.is_file():
        first = listing.read_text(encoding="utf-8", errors="replace").split("\n\n", 1)[0]
        facts += [line for line in first.splitlines() if line.startswith(fields)]
    else:
        facts.append(platform.processor())
    return "\n".join(facts)


def cache_folder() -> Path:
    """Where libraries compiled on demand are kept: the user's cache."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "dart-hal" / "kernels"


def compile_kernel(source: str, variant: Variant, folder: Path, *,
                   portable: bool = False) -> Path:
    """The library of ``source`` in ``folder``, compiled unless it is there already.

    portable: for every processor of this architecture, instead of this one.
    Raises CannotCompile; then ``folder`` holds nothing new.
    """
    target = folder / f"{key(source, variant, portable=portable)}.so"
    if target.is_file():
        with contextlib.suppress(OSError):  # what others installed may not be touched
            os.utime(target)
        return target
    command = compiler()
    if command is None:
        raise CannotCompile(f"no C compiler ({os.environ.get('CC') or 'cc, gcc, clang'})")
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        with tempfile.TemporaryDirectory(dir=folder, prefix=".building-") as scratch:
            library = _build(command, source, variant, Path(scratch),
                             PORTABLE_OPTIONS if portable else MACHINE_OPTIONS)
            os.replace(library, target)   # whole or not at all, whoever else compiles it too
    except OSError as why:
        raise CannotCompile(f"cannot write to {folder}: {why}") from why
    _delete_oldest(folder)
    return target


def _delete_oldest(folder: Path) -> None:
    """Delete the libraries that were not used for longest."""
    times: dict[Path, float] = {}
    for path in folder.glob("kernel-*.so"):
        with contextlib.suppress(FileNotFoundError):  # swept by another process
            times[path] = path.stat().st_mtime
    for path in sorted(times, key=times.__getitem__)[:-MAX_CACHED_LIBRARIES]:
        path.unlink(missing_ok=True)


def _build(command: list[str], source: str, variant: Variant, scratch: Path,
           machines: tuple[tuple[str, ...], ...]) -> Path:
    """Compile and link, with the first options of ``machines`` that the compiler knows."""
    text, thing, library = (scratch / f"kernel{suffix}" for suffix in (".c", ".o", ".so"))
    text.write_text(source, encoding="utf-8")
    _run_first([[*command, *machine, *variant.options, "-c", str(text), "-o", str(thing)]
                for machine in machines])
    # linked without -ffast-math: with it gcc adds code that switches off denormal
    # numbers for everybody in the process that loads the library
    _run_first([[*command, "-shared", str(thing), "-o", str(library), *vectors, "-lm"]
            for vectors in VECTOR_MATH])
    return library


def _run_first(commands: list[list[str]]) -> None:
    """Run the first command that succeeds. Raises CannotCompile with the last message."""
    message = ""
    for command in commands:
        try:
            done = subprocess.run(command, capture_output=True, text=True, check=False,
                                  timeout=TIMEOUT_S)
        except (OSError, subprocess.TimeoutExpired) as why:
            raise CannotCompile(f"{command[0]}: {why}") from why
        if done.returncode == 0:
            return
        message = (done.stderr.strip() or f"exit status {done.returncode}").splitlines()[0]
    raise CannotCompile(f"{commands[-1][0]} failed: {message}")


def build_committed(folder: Path = BUILT, *, portable: bool = False) -> list[Path]:
    """All variants of the committed kernels, old ones of the kind swept out.

    Raises CannotCompile.
    """
    source = COMMITTED.read_text(encoding="utf-8")
    built = [compile_kernel(source, variant, folder, portable=portable) for variant in VARIANTS]
    for old in folder.glob("kernel-*.so"):
        if old not in built and ("-portable-" in old.name) is portable:
            old.unlink()
    return built
