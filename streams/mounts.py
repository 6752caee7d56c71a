"""What a folder's file system is: some tell nobody of changes, some lose committed writes."""

from __future__ import annotations

import os
from pathlib import Path

NETWORK_FILE_SYSTEMS = frozenset(
    {"9p", "afs", "ceph", "cifs", "fuse.ceph", "fuse.glusterfs", "fuse.sshfs", "glusterfs", "lustre", "ncpfs", "nfs"}
    | {"nfs4", "smb3", "smbfs", "virtiofs", "vboxsf"}
)
"""Types whose files other machines write: no event tells of it, and no lock or shared memory can be relied upon."""

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
