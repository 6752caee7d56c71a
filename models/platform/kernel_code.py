"""Machine code of kernels: each is optimised and generated once, and called by the others where it stands.

Numba gives each function copies of all that it calls, however deep, which are optimised and generated anew in every
caller: ten times the code of the kernels of a settled scene. Here a kernel is declared in its callers and found by its
name when they are linked. A function to paste is optimised, but has no machine code of its own: it lives in callers.
"""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false, reportUnknownArgumentType=false
# pyright: reportMissingTypeStubs=false, reportUnnecessaryComparison=false

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, cast
from weakref import WeakKeyDictionary

import llvmlite.binding as llvm
import numba
from numba.core import codegen as code_generation
from numba.core import compiler
from numba.core.environment import lookup_environment
from numba.core.registry import CPUDispatcher

# Of llvmlite.binding.Linkage.
_SHARED = 3

NUMBERS: WeakKeyDictionary[Any, int] = WeakKeyDictionary()
"""By function of a kernel: a number in the name of its machine code, the same in each process that has its text."""

_JITLibrary: Any = cast("Any", code_generation).JITCodeLibrary
_Compiler: Any = cast("Any", compiler).Compiler


class _Library(_JITLibrary):
    """Code of functions that are defined in it, and not those that are only declared, is made smaller beforehand."""

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout
        manager, builder = self._codegen._function_pass_manager()
        for function in ll_module.functions:
            if not function.is_declaration:
                manager.run(function, builder)


class _CodeLibrary(_Library):
    """Machine code of a kernel, which is not copied into its callers.

    Attributes:
        origin: module, name and types of the arguments, by which another process finds it.
        symbol: its name in machine code.
    """

    origin: tuple[str, str, tuple[Any, ...]]
    symbol: str

    def _get_module_for_linking(self) -> Any:
        self._ensure_finalized()
        if self._shared_module is None:
            self._shared_module = llvm.parse_assembly(str(self._codegen._create_empty_module(self.name)))
        return self._shared_module

    def _finalize_final_module(self) -> None:
        # Copies of small functions of numba's own. Were they shared, the first of the process would be used, and each
        # is optimised where it stands: results would depend in their last bits on what was compiled before.
        for function in self._final_module.functions:
            if not function.is_declaration and int(function.linkage) == _SHARED:
                function.linkage = "internal"
        super()._finalize_final_module()
        # What is pasted into the kernel has set none.
        for variable in self._final_module.global_variables:
            environment = lookup_environment(variable.name)
            if environment is not None:
                self._codegen.set_env(variable.name, environment)


class _NoMachineCode:
    """Stands for the code generation of a library that generates none."""

    def set_env(self, *_: object) -> None:
        """Do nothing: the callers set it."""


class _PastedLibrary(_Library):
    """A function that is pasted into its callers: optimised, never generated."""

    codegen = _NoMachineCode()

    def _finalize_final_module(self) -> None:
        self._finalized = True

    def get_pointer_to_function(self, _name: str) -> int:
        """Return that there is none."""
        self._ensure_finalized()
        return 0


def called_kernels(library: Any) -> Iterator[Any]:
    """Yield the libraries of the kernels that a library calls, also through what is pasted into it, each once."""
    pending, seen = list(library._linking_libraries), set[int]()
    while pending:
        linked = pending.pop()
        if id(linked) in seen:
            continue
        seen.add(id(linked))
        if hasattr(linked, "origin"):
            yield linked
        elif isinstance(linked, _PastedLibrary):
            pending.extend(cast("Any", linked)._linking_libraries)


class _Sorted(set[str]):
    """A set whose text is the same in each process: numba has it in the names of machine code."""

    def __repr__(self) -> str:
        return repr(sorted(self))


class KernelCompiler(_Compiler):
    """Compiles a kernel."""

    def _compile_bytecode(self) -> Any:
        fastmath = self.state.flags.fastmath
        fastmath.flags = _Sorted(fastmath.flags)
        identity = self.state.func_id
        function = identity.func
        identity.unique_id = NUMBERS.get(function, identity.unique_id)
        library = _CodeLibrary(self.state.targetctx.codegen(), identity.func_qualname)
        library.enable_object_caching()
        library.origin = (function.__module__, function.__qualname__, tuple(self.state.args))
        self.state.library = library
        compiled = super()._compile_bytecode()
        library.symbol = compiled.fndesc.llvm_func_name
        return compiled


class _PastedCompiler(_Compiler):
    """Compiles a function that is pasted."""

    def _compile_bytecode(self) -> Any:
        self.state.library = _PastedLibrary(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        return super()._compile_bytecode()


class Pasted(CPUDispatcher):
    """A function that kernels paste. Called from Python, it is compiled as a function of its own."""

    def __init__(self, function: Any, options: dict[str, Any]) -> None:
        """Take the options of ``numba.njit``."""
        pasted = {**options, "nopython": True, "forceinline": True, "no_cpython_wrapper": True}
        cast("Any", super()).__init__(function, targetoptions=pasted, pipeline_class=_PastedCompiler)
        self._alone: Any = numba.njit(**options)(function)

    def add_overload(self, cres: Any) -> None:
        """Keep it for the kernels; Python finds none."""
        cast("Any", self).overloads[tuple(cres.signature.args)] = cres

    def _compile_for_args(self, *args: object, **kws: object) -> Any:
        return self._alone._compile_for_args(*args, **kws)
