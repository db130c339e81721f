"""The paper's edits: 2D editors draw views by a strategy, and the scene is fitted to them."""
