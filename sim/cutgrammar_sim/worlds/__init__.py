"""Worlds that carry out a cut: the bench, the board with a free knife, and the Kinova arm."""
