"""The stages of a study: collect, split, train, evaluate, plan."""
