"""What a folder's file system is, and how to make a file there durable."""

from __future__ import annotations

import os
from pathlib import Path

NETWORK_FILE_SYSTEMS = frozenset(
    {"9p", "afs", "ceph", "cifs", "fuse.ceph", "fuse.glusterfs", "fuse.sshfs", "glusterfs", "lustre", "ncpfs", "nfs"}
    | {"nfs4", "smb3", "smbfs", "virtiofs", "vboxsf"}
)
"""Types on which neither the locks nor the shared memory of a write-ahead log can be relied upon."""

_MOUNTS = Path("/proc/self/mountinfo")


def file_system_type(path: Path, mountinfo: str | None = None) -> str | None:
    """Return the type of the file system that holds ``path``, as the kernel's mount table names it.

    Args:
        path: an existing file or folder.
        mountinfo: text in the format of /proc/self/mountinfo; by default that file.

    Returns:
        The type ("ext4", "nfs4"), or None where it cannot be found out.
    """
    if mountinfo is None:
        try:
            mountinfo = _MOUNTS.read_text(encoding="utf-8", errors="replace")
        except OSError:
            return None
    device = path.stat().st_dev
    wanted = f"{os.major(device)}:{os.minor(device)}"
    for line in mountinfo.splitlines():
        fields, separator, tail = line.partition(" - ")
        parts = fields.split()
        if separator and len(parts) > 2 and parts[2] == wanted:
            return tail.split()[0]
    return None


def sync_folder(folder: Path) -> None:
    """Make the names in a folder durable: a rename survives a power cut only after this."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def replace_durably(temporary: Path, target: Path) -> None:
    """Put a finished file in the place of another at once: readers see the old one or the new one, never a part."""
    descriptor = os.open(temporary, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
    temporary.replace(target)
    sync_folder(target.parent)
