"""Generators of artificial transitions, of this package and from outside it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from marl_cair.generative.settings import GateConfig, GeneratorConfig, GeneratorSpec, NetworkSize
from marl_cair.lookup import LazyTable, import_when_used

if TYPE_CHECKING:
    from marl_cair.generative.generator import Generator

__all__ = ["GENERATORS", "GateConfig", "GeneratorConfig", "GeneratorSpec", "NetworkSize"]

GENERATORS: LazyTable[Callable[[GeneratorConfig, GeneratorSpec], Generator]] = LazyTable(
    {
        "ccdn": "marl_cair.generative.generator:CCDNGenerator",
        "ccgan": "marl_cair.generative.ccgan:CCGANGenerator",
        "ccdn_thesis": "marl_cair.generative.thesis:ThesisGenerator",
    },
    group="marl_cair.generators",
)
__getattr__ = import_when_used(
    __name__,
    {
        "CCDNGenerator": "marl_cair.generative.generator:CCDNGenerator",
        "GateReport": "marl_cair.generative.gate:GateReport",
        "Generator": "marl_cair.generative.generator:Generator",
    },
)
