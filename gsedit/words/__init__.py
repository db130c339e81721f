"""A reader of instructions: a sentence to changes, each with target, kind, amount and route."""
