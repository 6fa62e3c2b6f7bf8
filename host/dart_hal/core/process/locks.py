"""Locks on whole files that end with their process, and who holds them.

The kernel lists every lock for everybody in /proc/locks, and lets go of those
of a killed process at once: no file is left behind that says otherwise.
"""

from __future__ import annotations

import fcntl
import os
from contextlib import suppress
from pathlib import Path

from dart_hal.core.process.forks import private

LOCKS = Path("/proc/locks")
LONGEST_NAME = 60
"""Characters of a program's command line in a message."""


class FileLock:
    """An exclusive lock on ``path``, which is made if it is missing and never removed.

    A second one is refused in the same process too; a forked child does not
    keep it. Raises BlockingIOError when it is held, OSError.
    """

    def __init__(self, path: Path) -> None:
        self._file = open(_opened(path), "rb", buffering=0)  # noqa: SIM115 - held until release()
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            self._file.close()
            raise
        private(self._file)

    def release(self) -> None:
        """Let go; idempotent."""
        self._file.close()


def _opened(path: Path) -> int:
    """A descriptor of a file that every user may lock: reading it is enough for that.

    Made and opened in two steps: the kernel refuses to *make* a file that
    another user has left in a folder of everybody's.
    """
    with suppress(FileExistsError):
        made = os.open(path, os.O_RDONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        os.fchmod(made, 0o644)  # whatever the umask says
        return made
    return os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)


def holder(device: str | Path, locks: Path = LOCKS) -> int | None:
    """Process id of who has locked the file or port ``device``; None = nobody has.

    0: one whose number the kernel does not tell, as of another container.
    """
    try:
        node = os.stat(device)
    except OSError:
        return None
    return parse_locks(locks.read_text(encoding="ascii"), node.st_dev, node.st_ino)


def parse_locks(text: str, device: int, inode: int) -> int | None:
    """The owner of a whole-file lock in the text of /proc/locks.

    ``1: FLOCK  ADVISORY  WRITE 4711 00:06:1234 0 EOF``: process, then major
    and minor number of the file system in hexadecimal and the file's inode.
    Lines of waiting processes carry an arrow behind the number.
    """
    wanted = f"{os.major(device):02x}:{os.minor(device):02x}:{inode}"
    for line in text.splitlines():
        words = line.split()
        if words[1:2] == ["FLOCK"] and words[5:6] == [wanted]:
            return int(words[4])
    return None


def who(pid: int) -> str:
    """``pid 4711 (python3 drive.py)``, as far as /proc tells."""
    with suppress(OSError):
        line = Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").strip()
        return f"pid {pid} ({line.decode('utf-8', 'replace')[:LONGEST_NAME]})"
    return f"pid {pid}" if pid else "a program whose number the kernel does not tell"
