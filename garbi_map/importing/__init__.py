"""What other people recorded: which of their topics is what, and turning bags, images and tables into logs."""

from garbi_map.importing.bag import import_log
from garbi_map.importing.suggest import Suggestion, suggest_topics

__all__ = ["Suggestion", "import_log", "suggest_topics"]
