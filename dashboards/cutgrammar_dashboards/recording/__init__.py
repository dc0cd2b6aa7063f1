"""Trials as rerun recordings."""
