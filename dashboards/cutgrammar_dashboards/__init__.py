"""A record or a live trial made visible."""
