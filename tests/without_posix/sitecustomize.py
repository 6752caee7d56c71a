"""Takes from a Python process what only POSIX has; for processes with this folder in PYTHONPATH.

What the standard library and the tests themselves need on Linux stays: ``signal.SIGKILL``, ``socket.AF_UNIX``,
``os.getuid``, ``os.sysconf``, and ``os.statvfs`` for ``shutil.disk_usage``.
"""

from __future__ import annotations

import os
import select
import signal
import sys

MODULES = ("fcntl", "grp", "pty", "pwd", "resource", "syslog", "termios", "tty")
CALLS = {
    os: (
        *("fork", "forkpty", "geteuid", "getegid", "major", "minor", "memfd_create", "nice"),
        *("posix_fadvise", "posix_fallocate", "posix_spawn", "pread", "preadv", "pwrite", "pwritev"),
        *("register_at_fork", "sendfile", "set_blocking"),
        *("MFD_CLOEXEC", "O_CLOEXEC", "O_DIRECTORY", "O_NOFOLLOW", "O_NONBLOCK", "ST_RDONLY"),
    ),
    select: ("poll", "epoll"),
    signal: ("SIGHUP", "SIGXCPU", "SIGUSR1", "SIGUSR2"),
}


class _Refusing:
    """Finds no module of a system that is not POSIX."""

    @staticmethod
    def find_spec(name: str, path: object = None, target: object = None) -> None:
        del path, target
        if name in MODULES:
            raise ModuleNotFoundError(f"No module named {name!r} without POSIX", name=name)


for module, names in CALLS.items():
    for name in names:
        if hasattr(module, name):
            delattr(module, name)
for name in MODULES:
    sys.modules.pop(name, None)
sys.meta_path.insert(0, _Refusing())  # pyright: ignore[reportArgumentType]
