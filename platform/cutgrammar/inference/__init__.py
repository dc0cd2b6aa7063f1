"""Planning as inference (III-A, III-B): parse trees, their posterior and groundings, and tree search."""
