"""Sheets to draw figures on, and what is laid out on them."""
