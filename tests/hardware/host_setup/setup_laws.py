"""What every run of the set-up must hold: functions that a broken script fails."""

from __future__ import annotations

from setup_box import DATA, Box, list_announced

RULES = "system/etc/udev/rules.d/80-dart.rules"
UNIT = "system/etc/systemd/system/dart-hal.service"
ENVIRONMENT = "system/etc/dart-hal.env"


def plan_is_what_happens(box: Box) -> None:
    before = box.tree()
    plan = box.run("--dry-run")
    assert plan.returncode == 0, plan.stderr
    assert box.tree() == before, "a dry run leaves no trace"
    assert box.deeds == [], "and calls nothing that acts"
    done = box.run()
    assert done.returncode == 0, done.stderr + done.stdout
    assert list_announced(plan.stdout) == list_announced(done.stdout)
    for name in (RULES, UNIT, ENVIRONMENT):
        assert f"> {box.folder / name}" in list_announced(done.stdout), "no file without a word"


def second_run_does_nothing(box: Box) -> None:
    assert box.run().returncode == 0
    before = box.tree()
    again = box.run()
    assert again.returncode == 0
    assert list_announced(again.stdout) == []
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


def sleep_is_masked(box: Box) -> None:
    """A car drives on while its computer is suspended."""
    assert box.run().returncode == 0
    for target in ("sleep", "suspend", "hibernate", "hybrid-sleep"):
        link = box.root / "etc" / "systemd" / "system" / f"{target}.target"
        assert link.is_symlink(), target
        assert str(link.readlink()) == "/dev/null"


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
    assert list_announced(again.stdout) == []
