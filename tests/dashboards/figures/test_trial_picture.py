import numpy as np

from cutgrammar_dashboards.figures.trial_picture import HEIGHT, WIDTH, draw_configuration


def test_a_configuration_fills_its_space_and_is_not_cropped(story):
    _, goal, _ = story
    image = draw_configuration(goal, [(200, 30, 30)] * len(goal), 0.35)
    assert image.width >= WIDTH - 2 or image.height >= HEIGHT - 2
    assert image.width <= WIDTH
    assert image.height <= HEIGHT
    opacity = np.asarray(image)[..., 3]
    assert opacity.max() == 255
    assert not any(side.any() for side in (opacity[0], opacity[-1], opacity[:, 0], opacity[:, -1]))
