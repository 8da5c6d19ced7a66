"""From sweeps and a navigation filter's trajectory to one trajectory on which all sweeps agree."""

from garbi_map.register.agreement import ENTROPY_RADIUS, Agreement
from garbi_map.register.register import Registered, register
from garbi_map.register.scanner import Scanner
from garbi_map.register.settings import RegisterSettings

__all__ = ["ENTROPY_RADIUS", "Agreement", "RegisterSettings", "Registered", "Scanner", "register"]
