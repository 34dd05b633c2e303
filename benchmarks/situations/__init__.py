"""Situations whose true answer is known: whether an object can be placed there at all."""
