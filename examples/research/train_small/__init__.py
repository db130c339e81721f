"""How the weights of the editor `small` were made: pictures, prompts, target edits, training,
evaluation. README.md has the commands."""
