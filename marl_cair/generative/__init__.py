"""Generators of artificial transitions, of this package and from outside it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from marl_cair.lookup import LazyTable

if TYPE_CHECKING:
    from marl_cair.generative.generator import Generator
    from marl_cair.generative.settings import GeneratorConfig, GeneratorSpec

GENERATORS: LazyTable[Callable[[GeneratorConfig, GeneratorSpec], Generator]] = LazyTable(
    {
        "ccdn": "marl_cair.generative.generator:CCDNGenerator",
        "ccgan": "marl_cair.generative.ccgan:CCGANGenerator",
        "ccdn_thesis": "marl_cair.generative.thesis:ThesisGenerator",
    },
    group="marl_cair.generators",
)
