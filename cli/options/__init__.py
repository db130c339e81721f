"""Options that verbs share, and the records that hold their values."""
