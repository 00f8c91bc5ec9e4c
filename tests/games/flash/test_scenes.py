"""The scene classifier, on pictures like those of a game: the same scene in other positions."""

import numpy as np
import pytest

from marl_cair.games.flash.scenes import SceneClassifier


def draw_scene(name, rng):
    picture = np.full((90, 120, 3), 30, np.uint8)
    if name == "menu":
        picture[30:60, 40:80] = (200, 160, 40)
    elif name == "stage":
        picture[70:76] = (220, 220, 220)
        x = rng.integers(10, 110)
        picture[60:70, x - 5 : x + 5] = (40, 200, 90)
    else:
        picture[10:80, 10:110] = (160, 20, 20)
    return np.clip(picture + rng.integers(-9, 10, picture.shape), 0, 255).astype(np.uint8)


def test_scenes_are_recognised_in_pictures_that_it_was_not_trained_on(tmp_path):
    rng = np.random.default_rng(0)
    scenes = "menu", "stage", "over"
    classifier = SceneClassifier.train(
        {name: [draw_scene(name, rng) for _ in range(count)]
         for name, count in zip(scenes, (3, 8, 4), strict=True)}
    )  # fmt: skip
    shown = [(name, draw_scene(name, rng)) for name in scenes for _ in range(20)]
    assert [classifier.find_scene(picture) for _, picture in shown] == [name for name, _ in shown]
    chances = classifier.find_chances(shown[0][1])
    assert sum(chances.values()) == pytest.approx(1.0)
    path = tmp_path / "scenes.npz"
    classifier.save(path)
    again = SceneClassifier.load(path)
    assert again.names == classifier.names
    assert again.find_chances(shown[0][1]) == chances


def test_what_cannot_be_learned_or_read_is_refused(tmp_path):
    picture = np.zeros((90, 120, 3), np.uint8)
    with pytest.raises(ValueError, match="two scenes"):
        SceneClassifier.train({"menu": [picture]})
    with pytest.raises(ValueError, match="'over': 0"):
        SceneClassifier.train({"menu": [picture], "over": []})
    path = tmp_path / "scenes.npz"
    np.savez(path, names=np.array(["a", "b"]), weights=np.zeros((3, 2)))
    with pytest.raises(ValueError, match="no scene classifier"):
        SceneClassifier.load(path)
    path.write_bytes(b"junk")
    with pytest.raises(ValueError, match=r"scenes\.npz"):
        SceneClassifier.load(path)
