"""Trials: setups, goals, running a planner in a world, records and scores."""
