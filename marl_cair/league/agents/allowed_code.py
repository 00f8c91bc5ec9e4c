"""Permission and limits for agents that are code: `process:COMMAND` and `module:function`.

Code that the user names on the command line or in Python runs. Code that a file names (a league
file, `config.yaml`, a plan) needs permission: `require_allowed` is called where the file is read.
Mixtures hold no code. See SECURITY.md.
"""

from __future__ import annotations

import logging
import math
import os
import sys
from collections.abc import Iterable
from dataclasses import dataclass

from marl_cair import outside
from marl_cair.files import find_folder
from marl_cair.outside import CodeNotAllowedError, is_place
from marl_cair.text import clean_text

PREFIX = "process:"
# Agents of this package: naming them runs no foreign code.
OWN_AGENTS = frozenset({"marl_cair.games.deep_rts.teacher:make_teacher"})
ANSWER_SECONDS = 10.0
FUNCTION_SECONDS = 60.0  # the commands' limit for functions: networks may run without a GPU
IS_SUPERVISED = sys.platform == "linux"  # whether `supervisor` runs here

# Code of files that may run: all, none, or these sources, which the user has named.
AllowCode = bool | frozenset[str]


@dataclass(frozen=True)
class Limits:
    """Limits of an agent in a process of its own. Raises ValueError for an invalid limit, or one
    that this system cannot enforce.

    The memory is the address space of each of its processes (RLIMIT_AS): programs may reserve much
    more than they use, above all on a GPU, in Java or in Go.
    """

    seconds: float = ANSWER_SECONDS  # for each answer
    memory_bytes: int = 0  # 0: no limit
    processes: int = 0  # at once, checked every 50 ms (RLIMIT_NPROC counts those of the user)

    def __post_init__(self) -> None:
        if not 0.0 < self.seconds < math.inf:
            raise ValueError(f"answer_seconds is {self.seconds}, it must be above 0 and finite")
        named = ("answer_memory", self.memory_bytes), ("answer_processes", self.processes)
        for name, value in named:
            if not 0 <= value < 2**63:
                raise ValueError(f"{name} is {value}, it must be 0 or more")
            if value and not IS_SUPERVISED:
                raise ValueError(f"{name} is {value}: only Linux can limit it; leave it out here")


def is_process(source: str | os.PathLike[str]) -> bool:
    """Whether `source` names a command."""
    return str(source).startswith(PREFIX)


def is_foreign(source: str | os.PathLike[str]) -> bool:
    """Whether `source` names a function that makes an agent."""
    return is_place(str(source))


def is_code(source: str | os.PathLike[str]) -> bool:
    """Whether loading `source` runs foreign code; a folder that exists is no code."""
    if is_process(source):
        return True
    is_own = str(source) in OWN_AGENTS
    return is_foreign(source) and not is_own and not find_folder(source).is_dir()


def require_allowed(
    sources: Iterable[str], allow_code: AllowCode, place: str | os.PathLike[str]
) -> None:
    """Raise CodeNotAllowedError if `sources`, named in the file `place`, hold code that is not
    allowed. Logs code that is allowed although the user has not named it.
    """
    named = {*outside.list_allowed(), *(() if isinstance(allow_code, bool) else allow_code)}
    held = [one for one in dict.fromkeys(sources) if is_code(one)]
    code = [one for one in held if one not in named]
    listed = ", ".join(map(clean_text, code))
    if code and allow_code is not True:
        raise CodeNotAllowedError(
            f"{place} names code, which runs only if you allow it: {listed}. If you trust it, add "
            "--allow-code (to `marl-cair train resume=...`: allow_code=true), or name it in the "
            f"environment variable {outside.ALLOWED}, divided by commas"
        )
    outside.allow_code(*filter(is_place, held))  # agents of the run have the same networks
    if code:
        logging.getLogger(__name__).warning("running code that %s names: %s", place, listed)
