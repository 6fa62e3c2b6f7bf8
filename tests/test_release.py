"""`make release`: what it refuses, and that its archives are the same each time."""

from __future__ import annotations

import hashlib
import importlib.util
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
_spec = importlib.util.spec_from_file_location("release", ROOT / "release.py")
release = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(release)

LOG = "# Changelog\n\n## Unreleased\n\n- new\n\n## 0.1.0 - 2026-09-01\n\n- old\n"


def test_this_checkout_states_one_version_everywhere():
    assert release.agreed(release.versions(ROOT))


def test_files_of_different_versions_are_named():
    with pytest.raises(release.CannotRelease, match=r"a says 0\.1, b says 0\.2"):
        release.agreed({"a": "0.1", "b": "0.2"})


@pytest.mark.parametrize(("version", "heading", "text"), [
    ("0.1.0", "0.1.0 - 2026-09-01", "- old\n"), ("0.2.0", "Unreleased", "- new\n")])
def test_the_notes_are_the_section_of_the_version(version, heading, text):
    assert release.notes(LOG, version) == (heading, text)


def test_a_changelog_without_a_section_is_refused():
    with pytest.raises(release.CannotRelease, match="YYYY-MM-DD"):
        release.notes("# Changelog\n", "0.1.0")


@pytest.mark.parametrize("same", [True, False])
def test_firmware_of_another_checksum_is_refused(tmp_path, same):
    path = tmp_path / release.FIRMWARE
    path.parent.mkdir(parents=True)
    path.write_bytes(b":00000001FF\n")
    stated = hashlib.sha256(path.read_bytes() if same else b"other").hexdigest()
    path.with_suffix(".hex.sha256").write_text(f"{stated}  {path.name}\n")
    if same:
        assert release.checked_firmware(tmp_path) == path
    else:
        with pytest.raises(release.CannotRelease, match="make -C firmware prebuilt"):
            release.checked_firmware(tmp_path)


def test_an_archive_hangs_on_its_files_alone(tmp_path):
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "a").write_text("1")
    sums = []
    for order in (("a", "b"), ("b", "a")):
        (tmp_path / "in" / "b").write_text("2")  # another time of the file
        files = {name: tmp_path / "in" / name for name in order}
        release.archive(tmp_path / "x.zip", files, 1.7e9)
        sums.append(hashlib.sha256((tmp_path / "x.zip").read_bytes()).hexdigest())
    assert sums[0] == sums[1]
    assert zipfile.ZipFile(tmp_path / "x.zip").namelist() == ["a", "b"]


@pytest.mark.long
def test_a_whole_release_and_its_checksums(tmp_path):
    pytest.importorskip("weasyprint")
    pytest.importorskip("sphinx")
    done = subprocess.run([sys.executable, ROOT / "release.py", "--draft", "--out", tmp_path],
                          capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    (folder,) = tmp_path.iterdir()
    names = {path.name.split("-")[-1].rsplit(".", 1)[-1] for path in folder.iterdir()}
    assert {"whl", "gz", "zip", "pdf", "hex", "md", "SHA256SUMS"} <= names
    subprocess.run(["sha256sum", "-c", "--quiet", "SHA256SUMS"], cwd=folder, check=True)
