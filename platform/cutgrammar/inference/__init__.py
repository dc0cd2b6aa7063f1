"""Planning as inference (III-A, III-B): parse trees, their posterior, groundings, and the search for the best."""
