"""The robot arm that makes the cuts (IV-D)."""
