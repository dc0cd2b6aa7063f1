"""The arm that makes the cuts (IV-D): its model, how it reaches a plane, presses, turns what lies badly, and its world."""
