"""World -> picture."""
from marl_cair.games.compiled import compiled

IMAGE_WIDTH, IMAGE_HEIGHT, GRAY_SIDE = 800, 600, 84


def draw(worlds, rules, world, player):
    raise NotImplementedError


def observe_image(worlds, rules, out, first, last):
    raise NotImplementedError


observe_gray = observe_image
