"""What a planner's best plan scores, in words."""

from cutgrammar.interfaces import Explanation


def criterion(why: Explanation) -> str:
    """The name of what plans are ranked by, which `Explanation.history` holds."""
    return "log posterior" if why.predicted_iou is None else "predicted strict IoU"


def score_text(why: Explanation) -> str:
    """The score of the best plan, and its terms if it has any.

    Example: "log posterior -31.2 = prior -4.0 + shape -20.1 + layout -7.1".
    """
    if why.predicted_iou is not None:
        return f"{criterion(why)} {why.predicted_iou:.3f}"
    terms = f"prior {why.log_prior:.1f} + shape {why.log_shape:.1f} + layout {why.log_layout:.1f}"
    terms += "" if why.log_volume is None else f" + volume {why.log_volume:.1f}"
    return f"{criterion(why)} {why.log_posterior:.1f} = {terms}"
