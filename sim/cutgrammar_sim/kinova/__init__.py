"""The arm that makes the cuts (IV-D): its model, how it reaches and presses, turns what lies badly, and its world."""
