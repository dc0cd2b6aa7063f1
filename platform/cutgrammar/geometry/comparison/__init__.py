"""Similarity of two fragments: volume overlap, overlap with refined rotation, and spectral distance."""
