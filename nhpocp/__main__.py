"""`python -m nhpocp` is the program `nhpocp`."""

from nhpocp.cli.entry import main

main()
