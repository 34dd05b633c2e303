"""Figures that explain how the search works, drawn from what it really does."""
