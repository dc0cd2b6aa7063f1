"""Commands that show, view, film, export and reproduce what is on disk."""
