"""`python -m gsedit_cli`: the command line."""

from .main import main

main()
