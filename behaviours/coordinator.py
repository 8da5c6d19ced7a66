"""Hybrid coordination (Carreras et al., Girona: behaviours merge by activation, the dominant suppresses), safety last.

Of two proposals the one of higher priority is dominant. On each axis that both care for,

    a = min(1, ad + an (1 - ad)^k),   v = (vd ad + vn an (1 - ad)^k) / a

with k = 1; on an axis that one of them leaves free the other decides alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from behaviours.types import AXES, Command, Proposal

SUPPRESSION = 1
NEGLIGIBLE = 1e-6


@dataclass(frozen=True)
class Coordinated:
    """The merged command, who carried most of it, and how in words."""

    command: Command
    winner: str
    words: str


def coordinate(proposals: list[Proposal], now_ns: int) -> Coordinated:
    """Merge what has not expired, from the highest priority down; nothing active: stop."""
    valid = [one for one in proposals if one.expires_ns > now_ns and one.activation > NEGLIGIBLE]
    valid.sort(key=lambda one: (-one.priority, one.name))
    values, total = np.zeros(4), np.zeros(4)
    shares: dict[str, float] = {}
    for one in valid:
        mask = np.array([axis in one.axes for axis in AXES], float)
        share = min(one.activation, 1.0) * mask * (1.0 - total) ** SUPPRESSION
        values += share * one.command.array()
        total = np.minimum(total + share, 1.0)
        shares[one.name] = float(share.max())
    if not shares:
        return Coordinated(Command(), "none", "no behaviour is active: stop")
    command = Command.of(np.divide(values, total, out=np.zeros(4), where=total > 1e-9))
    winner = max(shares, key=lambda name: shares[name])
    words = ", ".join(f"{name} {100 * share:.0f} %" for name, share in shares.items())
    return Coordinated(command, winner, words)
