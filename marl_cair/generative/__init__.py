"""Generators of artificial transitions. A new generator is one file and one line here."""

from collections.abc import Callable

from marl_cair.generative.gate import GateReport
from marl_cair.generative.generator import CCDNGenerator, Generator
from marl_cair.generative.settings import GateConfig, GeneratorConfig, GeneratorSpec, NetworkSize

GENERATORS: dict[str, Callable[[GeneratorConfig, GeneratorSpec], Generator]] = {
    "ccdn": CCDNGenerator,
}

__all__ = [
    "GENERATORS",
    "CCDNGenerator",
    "GateConfig",
    "GateReport",
    "Generator",
    "GeneratorConfig",
    "GeneratorSpec",
    "NetworkSize",
]
