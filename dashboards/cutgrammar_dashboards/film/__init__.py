"""Films of trials."""
