"""From a production to a cutting plane (III-C)."""
