"""Which settings learning reads; without torch, for those that only compare models."""

import dataclasses

from cutgrammar.settings import Settings


def settings_used(settings: Settings, vision: bool = False) -> Settings:
    """`settings` with those that learning does not read at their defaults, so that equal models have equal settings.

    Args:
        settings: all of them.
        vision: whether the segmentation is learned too; it reads the settings of the scenes it is trained on.
    """
    others = Settings()
    if vision:
        seen = dataclasses.replace(settings.vision, belief=others.vision.belief, seams=others.vision.seams)
        others = Settings(world=settings.world, cameras=settings.cameras, vision=seen)
    return dataclasses.replace(
        others,
        features=settings.features,
        induction=settings.induction,
        classifier=settings.classifier,
        planes=settings.planes,
        baselines=settings.baselines,
    )
