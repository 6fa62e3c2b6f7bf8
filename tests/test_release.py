"""`make release`: what it refuses, and that its archives are the same each time."""

from __future__ import annotations

import hashlib
import importlib.util
import re
import shutil
import subprocess
import sys
import zipfile
from importlib import metadata

import pytest

from tests.common import ROOT

_spec = importlib.util.spec_from_file_location("release", ROOT / "release.py")
release = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(release)

LOG = "# Changelog\n\n## 0.1.0 - 2026-09-01\n\n- old\n"


def test_this_checkout_states_its_version_once():
    version = release.read_version(ROOT)
    assert metadata.version("dart-hal") == version
    stated = [name for name in ("pyproject.toml", "CITATION.cff")
              if f"version = \"{version}\"" in (text := (ROOT / name).read_text(encoding="utf-8"))
              or f"version: {version}" in text]
    assert not stated


def test_a_package_without_a_version_is_refused(tmp_path):
    (tmp_path / "host" / "dart_hal").mkdir(parents=True)
    (tmp_path / "host" / "dart_hal" / "__init__.py").write_text("")
    with pytest.raises(release.CannotRelease, match="states no version"):
        release.read_version(tmp_path)


def test_the_notes_are_the_section_of_the_version():
    assert release.notes(LOG, "0.1.0") == ("0.1.0 - 2026-09-01", "- old\n")


@pytest.mark.parametrize("version", ["0.2.0", "0.1"])
def test_a_changelog_without_a_section_is_refused(version):
    with pytest.raises(release.CannotRelease, match="towncrier build"):
        release.notes(LOG, version)


def test_this_version_has_its_notes():
    heading, text = release.notes((ROOT / "CHANGELOG.md").read_text(encoding="utf-8"),
                                  release.read_version(ROOT))
    assert heading.endswith("2026-11-28")
    assert "### Added" in text


def test_new_entries_of_the_changelog_have_a_known_kind():
    names = {path.name for path in (ROOT / "changelog.d").iterdir()}
    assert all(re.fullmatch(r"README\.md|\+[a-z0-9-]+\.(added|changed|fixed|removed)\.md", name)
               for name in names), names


@pytest.mark.slow
def test_new_entries_become_a_section(tmp_path):
    pytest.importorskip("towncrier")
    shutil.copyfile(ROOT / "pyproject.toml", tmp_path / "pyproject.toml")
    shutil.copyfile(ROOT / "CHANGELOG.md", tmp_path / "CHANGELOG.md")
    (tmp_path / "changelog.d").mkdir()
    (tmp_path / "changelog.d" / "+brake.fixed.md").write_text("The brake holds.")
    subprocess.run([sys.executable, "-m", "towncrier", "build", "--yes", "--version", "9.8.7",
                    "--date", "2030-01-02"], cwd=tmp_path, check=True, capture_output=True)
    changelog = (tmp_path / "CHANGELOG.md").read_text(encoding="utf-8")
    heading, text = release.notes(changelog, "9.8.7")
    assert heading == "9.8.7 - 2030-01-02"
    assert "### Fixed" in text
    assert "- The brake holds." in text
    assert changelog.index("## 9.8.7") < changelog.index("## 0.2.0") < changelog.index("## 0.1.0")


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


@pytest.mark.parametrize(("tags", "refused"), [
    (["any", "manylinux_2_28_x86_64"], ""), (["any"], ""),
    (["any", "linux_x86_64"], "indexes refuse"), (["manylinux_2_28_aarch64"], "no py3-none-any")])
def test_wheels_with_tags_of_no_use_are_refused(tmp_path, tags, refused):
    for tag in tags:
        (tmp_path / f"dart_hal-1.0-py3-none-{tag}.whl").touch()
    if not refused:
        release.check_tags(tmp_path)
        return
    with pytest.raises(release.CannotRelease, match=refused):
        release.check_tags(tmp_path)


@pytest.mark.long
def test_a_whole_release_and_its_checksums(tmp_path):
    pytest.importorskip("weasyprint")
    pytest.importorskip("sphinx")
    pytest.importorskip("auditwheel")
    pytest.importorskip("cyclonedx_py")
    done = subprocess.run([sys.executable, ROOT / "release.py", "--draft", "--out", tmp_path],
                          capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    (folder,) = tmp_path.iterdir()
    names = {path.name.split("-")[-1].rsplit(".", 1)[-1] for path in folder.iterdir()}
    assert {"whl", "gz", "zip", "pdf", "hex", "md", "json", "SHA256SUMS"} <= names
    assert len(list(folder.glob("*.whl"))) == 2
    subprocess.run(["sha256sum", "-c", "--quiet", "SHA256SUMS"], cwd=folder, check=True)
