"""Training: from demonstrations to a model."""
