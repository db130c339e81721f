"""Run a command: parse it, show its progress, and end it with an exit code."""
