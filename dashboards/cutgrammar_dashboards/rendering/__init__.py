"""Images of fragments."""
