"""Reader of instructions: a sentence to the looks that the editor `small` knows."""
