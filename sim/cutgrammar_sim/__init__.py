"""Worlds that carry out a cut, the foods they hold, and the scripted demonstrator."""
