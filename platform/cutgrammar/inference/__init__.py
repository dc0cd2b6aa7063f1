"""Inference of the best parse tree (Section III-A, III-B): posterior, grounding, search."""
