"""`python -m velocal.cli` is the same as `velocal`."""

from velocal.cli import main

main()
