"""Training of the reader of sentences."""
