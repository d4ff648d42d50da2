"""`python -m velocal.cli` is the same as `velocal` and `python -m velocal`."""

from velocal.cli import main

main()
