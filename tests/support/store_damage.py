"""Makers and checks that tests of store damage share."""

from __future__ import annotations

from collections.abc import Callable

PAGE = 4096


def zero(data: bytearray, place: int, _: int) -> None:
    start = place % len(data) // PAGE * PAGE
    data[start : start + PAGE] = bytes(len(data[start : start + PAGE]))


class CutOffError(BaseException):
    """Stands for a process that ends here."""


class CutOff:
    """Ends a process at the n-th call of what is counted."""

    def __init__(self, n: int) -> None:
        self._left = n

    def counted(self, function: Callable[..., object]) -> Callable[..., object]:
        def wrapped(*arguments: object, **more: object) -> object:
            self._left -= 1
            if self._left == 0:
                raise CutOffError
            return function(*arguments, **more)

        return wrapped
