"""The scripted demonstrator, which cuts foods as people do (IV-A)."""
