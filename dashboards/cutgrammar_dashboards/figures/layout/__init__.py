"""Sheets on which figures are drawn, and layouts of fragments and parse trees on them."""
