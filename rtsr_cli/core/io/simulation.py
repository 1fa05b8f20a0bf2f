"""The simulation's old place, for modules that have not moved yet."""

from rtsr_cli.core.pairs.simulation import Simulation

__all__ = ["Simulation"]
