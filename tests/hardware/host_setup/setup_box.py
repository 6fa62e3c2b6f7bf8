"""A computer made of fakes: a root folder, a home, and commands that note their calls."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

from tests.common import ROOT

SETUP = ROOT / "host" / "setup"
PASSED_ON = ("install", "mv", "rm", "ln", "touch", "mkdir", "env")
"""Fakes that note the call and hand it to the real command."""
FAKES = (*PASSED_ON, "sudo", "uname", "id", "date", "getconf", "df", "modinfo", "modprobe",
         "dpkg-query", "apt-get", "getent", "groupadd", "usermod", "raspi-config", "curl",
         "udevadm", "systemctl")
TOOLS = ("sh", "dirname", "basename", "grep", "sed", "tr", "head", "tail", "cat", "awk", "wc",
         "cut", "readlink", "sha256sum", "cmp", "mktemp", "cp", "chmod", "flock")
DATA = ".local/share/dart-hal"
CALM = {"uname", "id", "date", "getconf", "df", "modinfo", "dpkg-query", "getent"}
"""Commands that only look."""


class Box:
    """A Jetson Nano with a CH340 plugged in, fresh from its image, unless stated otherwise.

    ``checkout`` is a copy that a test may break; ``run`` calls its setup.sh.
    """

    def __init__(self, folder: Path, *, board: str = "NVIDIA Jetson Nano Developer Kit") -> None:
        self.folder = folder
        self.root = folder / "system"
        self.home = folder / "home"
        self.checkout = folder / "checkout"
        self.state = folder / "state"
        self._copy_checkout()
        for path in (self.root / "dev", self.home, self.state):
            path.mkdir(parents=True)
        self.put("etc/os-release", 'ID=ubuntu\nVERSION_ID="18.04"\nPRETTY_NAME="Ubuntu 18.04"\n')
        self.put("proc/device-tree/model", board + "\0")
        self.put("dev/i2c-1", "")
        self.put("run/udev/control", "")
        self.put("run/systemd/system/.keep", "")
        self.plug("1a86", "7523")
        self.set("drivers", "ch341", "ftdi_sio")
        self.set("packages", "curl")
        self.set("groups", "driver", "sudo")
        self.set("known_groups", "dialout")
        self._make_commands()

    def _copy_checkout(self) -> None:
        shutil.copytree(SETUP, self.checkout / "host" / "setup")
        (self.checkout / "cars" / "dart-01").mkdir(parents=True)
        shutil.copy(ROOT / "cars" / "dart-01" / "car.toml", self.checkout / "cars" / "dart-01")
        shutil.copy(ROOT / "pyproject.toml", self.checkout)

    def _make_commands(self) -> None:
        fake = self.folder / "fake"
        shutil.copy(Path(__file__).parent / "fake_command.sh", fake)
        fake.chmod(0o755)
        (self.folder / "bin").mkdir()
        for name in FAKES:
            (self.folder / "bin" / name).symlink_to(fake)
        (self.folder / "uv").symlink_to(fake)
        (self.folder / "tools").mkdir()         # the real ones: no Python 3.11, no uv of the host
        for name in (*TOOLS, *PASSED_ON):
            real = shutil.which(name)
            assert real, f"{name} is not on this computer"
            (self.folder / "tools" / name).symlink_to(real)

    # -- the computer ------------------------------------------------------

    def put(self, path: str, text: str) -> Path:
        """A file below the root."""
        target = self.root / path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(text)
        return target

    def plug(self, vendor: str, product: str) -> None:
        """The USB device of the Nano."""
        self.put("sys/bus/usb/devices/1-1/idVendor", vendor + "\n")
        self.put("sys/bus/usb/devices/1-1/idProduct", product + "\n")

    def set(self, kind: str, *words: str) -> None:
        """What the fakes know: drivers, packages, groups, known_groups."""
        (self.state / kind).write_text("".join(w + "\n" for w in words))

    def remove_command(self, command: str) -> None:
        (self.folder / "bin" / command).unlink()

    def change(self, name: str, old: str, new: str) -> None:
        """Break a copy of one of the scripts, for a negative control."""
        path = self.checkout / "host" / "setup" / name
        text = path.read_text()
        assert old in text, f"{name} has no {old!r}"
        path.write_text(text.replace(old, new, 1))

    # -- running -----------------------------------------------------------

    def run(self, *options: str, script: Path | None = None, timeout: float = 60.0,
            **environment: str) -> subprocess.CompletedProcess[str]:
        """The script in a process group of its own; the list of calls restarts."""
        (self.folder / "calls").write_text("")
        script = script or self.checkout / "host" / "setup" / "setup.sh"
        return subprocess.run(
            ["sh", str(script), *options], capture_output=True, text=True, timeout=timeout,
            check=False, stdin=subprocess.DEVNULL, start_new_session=True, cwd=self.folder,
            env={"PATH": f"{self.folder}/bin:{self.folder}/tools", "HOME": str(self.home),
                 "DESTDIR": str(self.root), "BOX": str(self.folder), "LC_ALL": "C", **environment})

    @property
    def calls(self) -> list[str]:
        """Every call of a fake in the last run, in order."""
        return (self.folder / "calls").read_text().splitlines()

    @property
    def deeds(self) -> list[str]:
        """Calls that may change something on the computer."""
        calm = ("sudo -n", "systemctl is-enabled", "rm -f /tmp/", "uv --version")
        return [c for c in self.calls if c.split()[0] not in CALM and not c.startswith(calm)
                and "uv python find" not in c and "/setup/new" not in c
                and not c.startswith(("mkdir -p", "uv python find"))]

    def tree(self) -> dict[str, str]:
        """Every file and link below root and home; locks and Debian's lists are no matter."""
        found = {}
        for top in (self.root, self.home, self.state):
            for path in sorted(p for p in top.rglob("*") if p.is_symlink() or p.is_file()):
                name = str(path.relative_to(self.folder))
                if path.name != "lock":
                    found[name] = (f"-> {os.readlink(path)}" if path.is_symlink()
                                   else path.read_text())
        return found


def list_announced(output: str) -> list[str]:
    """Commands and files that a run printed."""
    return [line.strip() for line in output.splitlines() if line.startswith(("   $ ", "   > "))]
