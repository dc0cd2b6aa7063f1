"""Whole studies from one settings file, with ablations."""
