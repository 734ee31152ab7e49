"""`python -m poil_drake` is the `poil` command."""

from poil_drake.cli import main

main()
