"""Types of the parts of pyfftw in use."""

from collections.abc import Sequence
from typing import Any

from numpy.typing import NDArray

__version__: str

def zeros_aligned(shape: int, dtype: str = ...) -> NDArray[Any]: ...
def export_wisdom() -> tuple[bytes, bytes, bytes]: ...
def import_wisdom(wisdom: tuple[bytes, bytes, bytes]) -> tuple[bool, bool, bool]: ...
def forget_wisdom() -> None: ...

class FFTW:
    def __init__(
        self,
        input_array: NDArray[Any],
        output_array: NDArray[Any],
        axes: Sequence[int] = ...,
        direction: str = ...,
        flags: Sequence[str] = ...,
        threads: int = ...,
    ) -> None: ...
    def execute(self) -> None: ...
