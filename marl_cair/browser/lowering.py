"""Compiles rules to a WebAssembly object file, from the code that numba made of them.

Numba's code before optimisation knows little of the processor: integers are of 64 bits, and arrays
are structures of pointers and 64-bit numbers that LLVM lays out. LLVM compiles it for WebAssembly
with 32-bit addresses as it is, and integers keep their 64 bits: the results are those of Python.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

TRIPLE = "wasm32-unknown-unknown"
# What Chromium 96, Firefox 89 and Safari 15 have; without the third, a float out of range traps.
_FEATURES = "+bulk-memory,+mutable-globals,+nontrapping-fptoint,+sign-ext"
# The one function of numba's library that rules call: whether an array can be reshaped in place,
# and its strides then. Numba takes only contiguous arrays here; those by columns are refused.
_LIBRARY = """
define i32 @numba_attempt_nocopy_reshape(i64 %axes, ptr %shape, ptr %strides, i64 %new_axes,
    ptr %new_shape, ptr %new_strides, i64 %item_bytes, i32 %is_by_columns) {
start:
  %refused = icmp ne i32 %is_by_columns, 0
  br i1 %refused, label %no, label %axis
axis:
  %left = phi i64 [ %new_axes, %start ], [ %index, %write ]
  %stride = phi i64 [ %item_bytes, %start ], [ %next, %write ]
  %is_done = icmp eq i64 %left, 0
  br i1 %is_done, label %yes, label %write
write:
  %index = sub i64 %left, 1
  %place = getelementptr i64, ptr %new_strides, i64 %index
  store i64 %stride, ptr %place
  %length_place = getelementptr i64, ptr %new_shape, i64 %index
  %length = load i64, ptr %length_place
  %next = mul i64 %stride, %length
  br label %axis
yes:
  ret i32 1
no:
  ret i32 0
}
"""
# Functions of the page, whose last bit may be another than Python's: observations and bots that
# round their results may call them, rules may not.
MATH = ("exp2", "log2")
_CALLED = re.compile(r'@"?([^"\s(),]+)"?\(')
_COMMON = re.compile(r" = common (?:local_unnamed_addr )?global")


@dataclass(frozen=True)
class Kernel:
    """A rule and what it is called with.

    Attributes:
        name: of the exported function, which takes the `Parameter`s among the arguments in their
            order (64-bit integers) and returns 0, or another number where the rule raised.
        rule: a function of `games.compiled`.
        arguments: arrays, numbers and named tuples of them; arrays become places in memory,
            numbers become constants.
    """

    name: str
    rule: Callable[..., Any]
    arguments: tuple[Any, ...]


class Parameter(int):
    """A whole number that the caller of the exported function gives."""


def keep_plain_code() -> None:
    """Let numba optimise nothing in this process from now on, and run rules that Python calls as
    plain Python.

    What numba optimises holds offsets into structures of 64-bit pointers: as WebAssembly it would
    read and write wrong places. Before that its code is the same for all processors of 64 bits.
    """
    from numba.core.codegen import JITCodeLibrary

    from marl_cair.games import compiled

    library: Any = JITCodeLibrary
    library._optimize_functions = lambda self, module: None
    library._optimize_final_module = lambda self: None
    rule: Any = compiled._Rule
    rule.__call__ = lambda self, *arguments: self.py_func(*arguments)


def compile_object(
    kernels: Sequence[Kernel],
    find_address: Callable[[NDArray[Any]], int],
    exact: Collection[str] = (),
) -> bytes:
    """One relocatable WebAssembly object with a function for each kernel; in a process of its own,
    after `keep_plain_code`.

    find_address: the place of an array in the WebAssembly memory.
    exact: names of kernels that may not call MATH; ValueError where one does.
    """
    import llvmlite.binding as llvm

    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    target = llvm.Target.from_triple(TRIPLE)
    machine = target.create_target_machine(opt=3, features=_FEATURES)
    whole: Any = llvm.parse_assembly(_head(machine))
    for kernel in kernels:
        rule, text = _lower(kernel)
        part = llvm.parse_assembly(_head(machine) + _COMMON.sub(" = internal global", text))
        wrapper = _write_wrapper(kernel, part.get_function(rule), find_address)
        part.link_in(llvm.parse_assembly(_head(machine) + _LIBRARY + wrapper))
        _hide_all_but(part, kernel.name)
        whole.link_in(part)
    whole.verify()
    options = llvm.create_pipeline_tuning_options(speed_level=2)
    builder = llvm.create_pass_builder(machine, options)
    builder.getModulePassManager().run(whole, builder)
    if inexact := set(MATH) & _list_called(whole, exact):
        raise ValueError(
            f"the rules call {', '.join(sorted(inexact))}, whose last bit differs from one browser "
            "to another: write them without, or with a table"
        )
    code: bytes = machine.emit_object(whole)
    return code


def _list_called(module: Any, names: Collection[str]) -> set[str]:
    """All functions that the functions `names` can reach, without the prefixes of LLVM's own."""
    calls = {one.name: set(_CALLED.findall(str(one))) for one in module.functions}
    reached, waiting = set(names), list(names)
    while waiting:
        new = calls.get(waiting.pop(), set()) - reached
        reached |= new
        waiting += new
    return {re.sub(r"^llvm\.(\w+)\.f64$", r"\1", name) for name in reached}


def _head(machine: Any) -> str:
    return f'target triple = "{TRIPLE}"\ntarget datalayout = "{machine.target_data}"\n'


def _lower(kernel: Kernel) -> tuple[str, str]:
    """The name of the rule's function and its LLVM code, with all that it calls."""
    from numba.core.compiler_lock import global_compiler_lock
    from numba.core.typing.typeof import Purpose, typeof

    rule: Any = kernel.rule
    arguments = (int(a) if isinstance(a, Parameter) else a for a in kernel.arguments)
    types = tuple(typeof(argument, Purpose.argument) for argument in arguments)
    rule.compile(types)
    compiled = rule.overloads[types]
    library: Any = compiled.library
    with global_compiler_lock:
        code = str(library._get_module_for_linking())
    lines = (line for line in code.splitlines() if not line.startswith("target "))
    return compiled.fndesc.llvm_func_name, "\n".join(lines)


def _hide_all_but(module: Any, name: str) -> None:
    """So that functions of two kernels with one name do not meet, and those unused are dropped."""
    for function in module.functions:
        if not function.is_declaration and function.name != name:
            function.linkage = "internal"


def _write_wrapper(
    kernel: Kernel, function: Any, find_address: Callable[[NDArray[Any]], int]
) -> str:
    """LLVM code of the exported function, which calls the rule with constants and parameters."""
    wanted = [str(argument.type) for argument in function.arguments]
    result, error, *types = wanted
    values = [v for argument in kernel.arguments for v in _flatten(argument, find_address)]
    if len(values) != len(types):
        raise AssertionError(f"{kernel.name}: {len(values)} values for {len(types)} arguments")
    parameters: list[str] = []
    words = []
    for value, kind in zip(values, types, strict=True):
        if isinstance(value, Parameter):
            parameters.append(f"i64 %p{len(parameters)}")
            words.append(parameters[-1])
        else:
            words.append(f"{kind} {_constant(value, kind)}")
    called = f'@"{function.name}"'
    arguments = ", ".join([f"{result} %result", f"{error} %error", *words])
    return (
        f"declare i32 {called}({', '.join(wanted)})\n"
        f'define i32 @"{kernel.name}"({", ".join(parameters)}) {{\n'
        f"  %result = alloca [64 x i8], align 16\n  %error = alloca ptr, align 8\n"
        f"  %status = call i32 {called}({arguments})\n  ret i32 %status\n}}\n"
    )


class _Pointer(int):
    """An address; 0 for none."""


def _flatten(argument: Any, find_address: Callable[[NDArray[Any]], int]) -> Iterator[Any]:
    """The values that numba passes for an argument: arrays as structures of seven and more."""
    if isinstance(argument, np.ndarray):
        yield from (_Pointer(0), _Pointer(0), argument.size, argument.itemsize)
        yield _Pointer(find_address(argument))
        yield from (*argument.shape, *argument.strides)
    elif isinstance(argument, tuple):
        for part in argument:
            yield from _flatten(part, find_address)
    else:
        yield argument


def _constant(value: Any, kind: str) -> str:
    """A number as LLVM writes it."""
    if isinstance(value, _Pointer):
        return f"inttoptr (i32 {int(value)} to ptr)" if value else "null"
    if kind == "double":
        return "0x" + np.float64(value).tobytes()[::-1].hex()
    return str(int(value))
