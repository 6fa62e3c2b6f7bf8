"""Lock whole files until the process ends, and find the process that locks a file.

The system releases the locks of a killed process at once, so there are no obsolete lock files.
Linux lists all locks in /proc/locks; elsewhere, the holder of a lock is not known.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from dart_hal.core.process.forks import private

# Flags that Windows lacks.
_OPEN_FLAGS = os.O_RDONLY | getattr(os, "O_CLOEXEC", 0)
_NO_LINK = getattr(os, "O_NOFOLLOW", 0)
LOCK_TABLE = Path("/proc/locks")
# Characters of a program's command line in a message.
MAX_COMMAND_LENGTH = 60


class FileLock:
    """An exclusive lock on ``path``, which is created if it is missing and never removed.

    A second lock fails in the same process too; a forked child does not inherit it. Raises
    BlockingIOError if the file is locked, OSError.
    """

    def __init__(self, path: Path) -> None:
        from portalocker import AlreadyLocked, LockException, LockFlags, lock

        self._file = open(_open_lockable(path), "rb", buffering=0)  # noqa: SIM115 - held until release()
        try:
            lock(self._file, LockFlags.EXCLUSIVE | LockFlags.NON_BLOCKING)
        except AlreadyLocked as error:
            self._file.close()
            raise BlockingIOError(f"{path} is locked") from error
        except LockException as error:
            self._file.close()
            raise OSError(f"{path} cannot be locked: {error}") from error
        private(self._file)

    def release(self) -> None:
        """Release the lock; idempotent."""
        self._file.close()


def _open_lockable(path: Path) -> int:
    """Return a descriptor of a file that every user may lock: that needs only read permission.

    It is created and opened in two steps: in a folder that everybody may write to, the kernel
    does not open another user's file with O_CREAT.
    """
    with suppress(FileExistsError):
        made = os.open(path, _OPEN_FLAGS | os.O_CREAT | os.O_EXCL, 0o644)
        if hasattr(os, "fchmod"):
            os.fchmod(made, 0o644)  # independent of the umask
        return made
    return os.open(path, _OPEN_FLAGS | _NO_LINK)


def holder(device: str | Path, locks: Path = LOCK_TABLE) -> int | None:
    """Return the id of the process that has locked the file or port ``device``, else None.

    0: a process whose id the kernel does not show, such as one of another container. None on
    systems that do not list their locks.
    """
    try:
        node = os.stat(device)
        table = locks.read_text(encoding="ascii")
    except OSError:
        return None
    return parse_locks(table, node.st_dev, node.st_ino)


def parse_locks(text: str, device: int, inode: int) -> int | None:
    """Return the owner of a whole-file lock from the text of /proc/locks.

    ``1: FLOCK  ADVISORY  WRITE 4711 00:06:1234 0 EOF``: process, then major
    and minor number of the file system in hexadecimal and the file's inode.
    Lines of waiting processes carry an arrow behind the number.
    """
    lock_id = f"{os.major(device):02x}:{os.minor(device):02x}:{inode}"
    for line in text.splitlines():
        words = line.split()
        if words[1:2] == ["FLOCK"] and words[5:6] == [lock_id]:
            return int(words[4])
    return None


def describe_process(pid: int) -> str:
    """Describe a process by id and command line: ``pid 4711 (python3 drive.py)``."""
    with suppress(OSError):
        line = Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").strip()
        return f"pid {pid} ({line.decode('utf-8', 'replace')[:MAX_COMMAND_LENGTH]})"
    return f"pid {pid}" if pid else "a program whose number the kernel does not tell"
