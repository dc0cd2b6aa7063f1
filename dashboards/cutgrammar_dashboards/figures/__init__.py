"""Figures of demonstrations, grammars, inferences and results."""
