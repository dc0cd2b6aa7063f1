"""Commands that show, view, film and export data sets, models, runs and trials."""
