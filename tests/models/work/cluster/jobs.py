"""Functions of tasks for workers of a cluster."""

from __future__ import annotations

import os


def repeated(shared: int, task: str) -> str:
    return shared * task


def dies_on(shared: int, task: int) -> int:
    if task == shared:
        os._exit(9)
    return task
