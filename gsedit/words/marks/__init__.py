"""A network that marks what a sentence asks for, and the tables that tell what the words mean."""
