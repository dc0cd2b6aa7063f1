"""Reading, checking and repairing users' mesh files."""
