"""What is seen of a fragment: point-cloud encoder, shape feature, fragment-type classifier (III-D)."""
