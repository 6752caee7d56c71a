"""Readers that do what damaged files make parsers do; they are called in the child process."""

from __future__ import annotations

import ctypes
import os
import sys
import time
from pathlib import Path

import numpy as np

from streams.types.samples import Samples


def pid(data: bytes, name: str) -> int:
    return os.getpid()


def answer_name(data: bytes, name: str) -> str:
    return name


def single(data: bytes, name: str) -> Samples:
    return Samples(np.array([[1.0, np.inf, -np.inf]], dtype=np.float32))


def segfault(data: bytes, name: str) -> None:
    ctypes.string_at(0)


def leave(data: bytes, name: str) -> None:
    os._exit(3)


def sleep(data: bytes, name: str) -> None:
    time.sleep(100)


def nap(data: bytes, name: str) -> int:
    time.sleep(0.6)
    return os.getpid()


def burn(data: bytes, name: str) -> None:
    while True:
        pass


def eat(data: bytes, name: str) -> int:
    return len(bytearray(3 << 30))


def write_much(data: bytes, name: str) -> None:
    handle = os.memfd_create("much")
    os.ftruncate(handle, 8 << 30)


def nonsense(data: bytes, name: str) -> Samples:
    return Samples(np.array([["a", "b"]]))


def fail(data: bytes, name: str) -> float:
    return 1 / len(data[:0])


def recurse(data: bytes, name: str) -> None:
    recurse(data, name)


def endless(data: bytes, name: str) -> str:
    return "a" * (8 << 20)


def not_json(data: bytes, name: str) -> object:
    return sys


def read_when_told(data: bytes, name: str) -> Samples:
    """Wait for the file whose path is the first line; the value is the second line, or 0."""
    path, _, value = data.decode().partition("\n")
    while not Path(path).exists():
        time.sleep(0.01)
    return Samples(np.full((1, 100), float(value or 0.0)))
