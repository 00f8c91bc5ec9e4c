"""Decides which agents' code may run: code named in a file needs the user's permission.

Code is `process:COMMAND` and `module:function`. Who names it on the command line or in Python runs
it. What a file names (a league's store, `config.yaml`, a plan) is passed through `require_allowed`
where it is read. Mixtures hold no code at all. See SECURITY.md.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Iterable

from marl_cair.files import find_folder
from marl_cair.text import clean_text

PREFIX = "process:"
# Agents that come with this package, so that naming them runs nothing new.
OWN_AGENTS = frozenset({"marl_cair.games.deep_rts.teacher:make_teacher"})

# Code of files that may run: all of it, none, or these sources, which the user has named.
AllowCode = bool | frozenset[str]


class CodeNotAllowedError(ValueError):
    """A file names code that the user has neither named nor allowed."""


def is_process(source: str | os.PathLike[str]) -> bool:
    """Whether `source` names a command."""
    return str(source).startswith(PREFIX)


def is_foreign(source: str | os.PathLike[str]) -> bool:
    """Whether `source` names a function that makes an agent."""
    module, colon, name = str(source).partition(":")
    return bool(colon) and name.isidentifier() and all(map(str.isidentifier, module.split(".")))


def is_code(source: str | os.PathLike[str]) -> bool:
    """Whether loading the agent `source` runs code of others; a folder that exists is none."""
    if is_process(source):
        return True
    is_own = str(source) in OWN_AGENTS
    return is_foreign(source) and not is_own and not find_folder(source).is_dir()


def require_allowed(
    sources: Iterable[str], allow_code: AllowCode, place: str | os.PathLike[str]
) -> None:
    """Raise CodeNotAllowedError where code among `sources`, which the file `place` names, is not
    allowed. Logs what is allowed and will run without having been named.
    """
    named = allow_code if isinstance(allow_code, frozenset) else frozenset()
    code = [one for one in dict.fromkeys(sources) if is_code(one) and one not in named]
    if not code:
        return
    listed = ", ".join(map(clean_text, code))
    if allow_code is not True:
        raise CodeNotAllowedError(
            f"{place} names code, which runs only if you allow it: {listed}. If you trust it, add "
            "--allow-code (to `marl-cair train`: allow_code=true)"
        )
    logging.getLogger(__name__).warning("running code that %s names: %s", place, listed)
