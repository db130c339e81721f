"""What an edit of a given scene can leave out, why, and what it may cost: pure functions."""
