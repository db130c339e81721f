"""`python -m gsedit_cli`, as torchrun starts it."""

from .main import main

main()
