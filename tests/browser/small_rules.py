"""Small rules, and a program that compiles each: prints its module and the places of its arrays, or
why it cannot be compiled, as JSON by name.
"""

import base64
import json
import sys

import numpy as np

from marl_cair.browser.kernels import Memory
from marl_cair.browser.lowering import Kernel, Parameter, compile_object, keep_plain_code
from marl_cair.browser.wasm_file import make_module
from marl_cair.games.compiled import compiled

STEP = np.uint64(0x9E3779B97F4A7C15)
TABLE = np.array([[5, -7, 11], [13, 17, -19]], np.int16)


@compiled
def wrap(words, times):
    """64-bit words overflow."""
    for turn in range(times):
        for index in range(words.shape[0]):
            words[index] = (words[index] ^ (words[index] >> np.uint64(27))) * STEP + np.uint64(turn)


@compiled
def fill(board, times):
    """Rows of three axes, filled through a view."""
    for index in range(board.shape[0]):
        view = board[index]
        view[:] = -times
        view[1:, :, 0] = index


@compiled
def flatten(board, times):
    """An array in another shape, and a constant table."""
    flat = board.reshape(board.size)
    for cell in range(board.size):
        flat[cell] = TABLE[cell % 2, cell % 3] * times


@compiled
def divide(numbers, shares, times):
    """Floor division and remainders of negative numbers, fractions, and a division by 0."""
    for index in range(numbers.shape[0]):
        numbers[index, 1] = numbers[index, 0] // times
        numbers[index, 2] = numbers[index, 0] % times
        shares[index] = numbers[index, 0] / (index + 0.1) * times
        shares[index] += 1.0 / (index - 1) if index != 1 else 0.0


@compiled
def count(numbers, times):
    """Small integers wrap when they are stored."""
    for index in range(numbers.shape[0]):
        for _ in range(times):
            numbers[index] += 100


@compiled
def logarithm(shares, times):
    """Calls a function of the page."""
    shares[0] = np.log2(shares[0] + times)


@compiled
def sine(shares, times):
    """Calls what is nowhere."""
    shares[0] = np.sin(shares[0] + times)


RULES = {
    "wrap": (wrap, lambda: [np.arange(9, dtype=np.uint64)]),
    "fill": (fill, lambda: [np.zeros((2, 3, 2, 5), np.int8)]),
    "flatten": (flatten, lambda: [np.zeros((2, 3, 3), np.int16)]),
    "divide": (
        divide,
        lambda: [np.arange(-40, 80, dtype=np.int64).reshape(-1, 6)[:, :3].copy(), np.zeros(20)],
    ),
    "count": (count, lambda: [np.arange(7, dtype=np.int8)]),
    "logarithm": (logarithm, lambda: [np.ones(1)]),
    "sine": (sine, lambda: [np.ones(1)]),
}


def compile_rule(rule, arrays):
    """The module in base64, with [address, bytes] of each array; or the error."""
    memory = Memory()
    kernel = Kernel("run", rule, (*arrays, Parameter()))
    try:
        code = compile_object([kernel], memory.find, exact=["run"])
        module = make_module(code, ["run"], memory.list_segments(), 1 << 20, "")
    except ValueError as error:
        return str(error)
    places = [(memory.find(array), array.nbytes) for array in arrays]
    return base64.b64encode(module).decode(), places


if __name__ == "__main__":
    keep_plain_code()
    made = {name: compile_rule(rule, make_arrays()) for name, (rule, make_arrays) in RULES.items()}
    json.dump(made, sys.stdout)
