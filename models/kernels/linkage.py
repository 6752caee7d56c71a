"""Make what a kernel computes independent of what else its process has compiled.

The machine code of a kernel holds a copy of each kernel that it calls, under a name that all code of the process shares
("linkonce_odr"). Of several copies the first is used: that of the kernel on its own where this process compiled it, the
caller's where both came from the cache. Each copy is optimised where it stands, so that their sums differ in the order
of terms and the results in their last bits: a process that compiled would disagree with all later ones. So each kernel
keeps its copies to itself, as if it had come from the cache.
"""

from __future__ import annotations

from typing import Any, cast

from numba.core import codegen

# Of llvmlite.binding.Linkage.
_SHARED = 3
_OURS = ("_ZN6models7kernels", "_ZN7cpython6models7kernels")


def keep_copies() -> None:
    """Give each kernel that is compiled from now on its own copies; without effect on other code of the process.

    Where a version of numba compiles in another way, its own rule remains.
    """
    library: Any = getattr(codegen, "CPUCodeLibrary", None)
    finalize = getattr(library, "_finalize_final_module", None)
    if finalize is None or hasattr(finalize, "keeps_copies"):
        return

    def finalize_with_copies(self: Any) -> Any:
        make_private(self._final_module)
        return finalize(self)

    cast("Any", finalize_with_copies).keeps_copies = True
    library._finalize_final_module = finalize_with_copies


def make_private(module: Any) -> None:
    """Make the copies in a compiled module private, where a kernel of this project is in it."""
    functions = [function for function in module.functions if not function.is_declaration]
    if not any(function.name.startswith(_OURS) for function in functions):
        return
    for function in functions:
        if int(function.linkage) == _SHARED:
            function.linkage = "internal"
