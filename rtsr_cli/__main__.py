"""`python -m rtsr_cli`."""

from rtsr_cli.cli import main

main()
