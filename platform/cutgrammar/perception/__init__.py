"""Perception of fragments: point-cloud encoder, shape feature, fragment-type classifier (III-D), and vision (IV-D)."""
