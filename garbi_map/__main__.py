"""`python -m garbi_map` is the `garbi` command."""

from garbi_map.cli import main

main()
