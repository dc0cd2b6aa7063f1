"""Collect, split, train, evaluate, report; the command line that puts it all together."""
