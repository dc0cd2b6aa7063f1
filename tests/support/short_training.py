"""Settings for training in a second or two."""

from cutgrammar.settings import from_tables

SHORT = from_tables(
    {
        "features": {"epochs": 2, "n_points": 128, "hidden_size": 16},
        "induction": {"max_k": 6, "n_starts": 1, "n_folds": 2},
        "classifier": {"epochs": 10, "hidden_size": 8, "n_folds": 2},
        "planes": {"epochs": 10, "hidden_size": 8, "n_folds": 2},
        "baselines": {"epochs": 10, "plane_epochs": 10, "hidden_size": 8, "embedding_size": 4, "n_folds": 2},
    },
    __file__,
)
