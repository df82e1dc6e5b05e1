"""Lets `python -m lippmann` do what the command `lippmann` does."""

from lippmann.cli import main

main()
