"""Trials: setups, the data set and its splits, running a planner in a world, records, the ledger, scores."""
