"""The command line `cutgrammar`."""
