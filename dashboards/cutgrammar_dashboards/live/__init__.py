"""Runs in a viewer while they work."""
