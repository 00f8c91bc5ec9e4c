"""Generators of artificial transitions. A new generator is one file and one line here."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from marl_cair.generative.settings import GateConfig, GeneratorConfig, GeneratorSpec, NetworkSize
from marl_cair.lookup import LazyTable

if TYPE_CHECKING:
    from marl_cair.generative.generator import Generator

__all__ = ["GENERATORS", "GateConfig", "GeneratorConfig", "GeneratorSpec", "NetworkSize"]

GENERATORS: LazyTable[Callable[[GeneratorConfig, GeneratorSpec], Generator]] = LazyTable(
    {"ccdn": "marl_cair.generative.generator:CCDNGenerator"}
)
_PLACES: LazyTable[Any] = LazyTable(
    {
        "CCDNGenerator": "marl_cair.generative.generator:CCDNGenerator",
        "GateReport": "marl_cair.generative.gate:GateReport",
        "Generator": "marl_cair.generative.generator:Generator",
    }
)


def __getattr__(name: str) -> Any:
    if name in _PLACES:
        return _PLACES[name]  # torch is loaded only from here on
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
