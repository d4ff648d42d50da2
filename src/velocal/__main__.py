"""`python -m velocal` is the same as `velocal`."""

from velocal.cli import main

main()
