"""Closed-loop trials of the behaviours on the dive simulator."""
