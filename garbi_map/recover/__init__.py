"""A damaged log in, everything that can be read of it out, and what was lost said: a room beside the flow, on `log`."""

from garbi_map.recover.recover import UNPROVEN, recover
from garbi_map.recover.report import Recovery, Stretch, TopicTally

__all__ = ["UNPROVEN", "Recovery", "Stretch", "TopicTally", "recover"]
