"""The forms in which users may name actions: `flat` as the engine has them, `factored` by kind and
cell, `continuous` by a point. A form maps actions and masks; it knows no environment.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.game import NO_CELL, GameSpec, Shape
from marl_cair.games.players.random_player import draw_legal
from marl_cair.lookup import find_by_name

NO_ACTION = -1


class FlatActions:
    """The engine's own form: at each place of the action shape one of A actions.

    Attributes, of every form:
        sizes: int64, the number of choices of each number that an action consists of; of shape ()
            where an action is one number.
        mask_shape: of one seat's mask.
    """

    sizes: NDArray[np.int64]
    mask_shape: Shape
    dtype_kinds: ClassVar[str] = "iu"  # of the dtypes of actions, as `np.dtype.kind`
    numbers: ClassVar[str] = "integers"

    def __init__(self, game: str, spec: GameSpec) -> None:
        self.sizes = np.full(spec.action_shape, spec.num_actions, np.int64)
        self.mask_shape = (*spec.action_shape, spec.num_actions)

    def to_engine(self, actions: NDArray[Any], player: int) -> NDArray[np.int64]:
        """The engine's actions [B, *action_shape] of one seat, from integers [B, *sizes.shape].
        Raises ValueError for a number outside its range that the engine would not check.
        """
        return actions

    def shape_mask(self, mask: NDArray[np.bool_]) -> NDArray[np.int8]:
        """The engine's mask bool [..., *action_shape, A] as int8 [..., *mask_shape]."""
        return mask.view(np.int8)

    def draw(self, mask: NDArray[np.int8], rng: np.random.Generator) -> NDArray[Any]:
        """A random action [*sizes.shape] that `mask` [*mask_shape] allows; here all legal actions
        are equally likely at each place.
        """
        return draw_legal(mask, rng)


class FactoredActions(FlatActions):
    """Two numbers: a kind of action (`GameSpec.action_groups`) and a cell of the own view.

    G kinds; C cells, row * columns + column of the representation `planes`, or 1 where no action
    points at a cell.

    The mask is int8 [G, C]: 1 where the action of that kind at that cell is legal. So a kind has
    legal actions where its row holds a 1 (`mask.any(axis=1)`, [G]), and `mask[kind]` [C] is the
    mask of its cells. For a kind without cells ("noop", "stop") the cell does not matter: its row
    is all 1 or all 0. (kind, cell) without an action is never legal and plays the no-op.

    Raises:
        ValueError: the scenario's actions have a shape already, or a kind has several actions at
            one place, so that kind and cell do not determine the action.
    """

    def __init__(self, game: str, spec: GameSpec) -> None:
        if spec.action_shape:
            raise ValueError(
                f"{game}: actions of shape {list(spec.action_shape)} cannot be factored by kind "
                "and cell; leave out action_form, they are MultiDiscrete as they are"
            )
        self._game, self._noop = game, spec.noop_action
        cells = np.asarray(spec.action_cells)
        points = cells != NO_CELL
        num_cells = int(np.prod(spec.representations["planes"].shape[-2:])) if points.any() else 1
        self._actions = np.full((len(spec.action_group_names), num_cells), NO_ACTION, np.int64)
        for action, group in enumerate(spec.action_groups.tolist()):
            places = cells[action] if points[action] else slice(None)
            if (self._actions[group, places] != NO_ACTION).any():
                raise ValueError(
                    f"{game}: actions cannot be factored by kind and cell, the kind "
                    f"{spec.action_group_names[group]!r} has several actions at one place; leave "
                    "out action_form"
                )
            self._actions[group, places] = action
        self._exists = self._actions != NO_ACTION
        self.mask_shape: Shape = self._actions.shape
        self.sizes = np.array(self.mask_shape, np.int64)

    def to_engine(self, actions: NDArray[Any], player: int) -> NDArray[np.int64]:
        """The flat action [B] of each (kind, cell) [B, 2]; the no-op where there is none."""
        wrong = np.argwhere((actions < 0) | (actions >= self.sizes))
        if len(wrong):
            world, factor = wrong[0].tolist()
            raise ValueError(
                f"{self._game}: the {('kind', 'cell')[factor]} {actions[world, factor]} of player "
                f"{player} in world {world} is outside 0..{self.sizes[factor] - 1}"
            )
        return self._flatten(*actions.T)

    def _flatten(self, kind: NDArray[Any], cell: NDArray[Any]) -> NDArray[np.int64]:
        """The flat action [B] of each kind and cell; the no-op where there is none."""
        flat = self._actions[kind, cell]
        return np.where(flat == NO_ACTION, self._noop, flat)

    def shape_mask(self, mask: NDArray[np.bool_]) -> NDArray[np.int8]:
        """A fresh array, int8 [..., G, C]."""
        legal: NDArray[np.bool_] = mask[..., self._actions] & self._exists
        return legal.view(np.int8)

    def draw(self, mask: NDArray[np.int8], rng: np.random.Generator) -> NDArray[Any]:
        """First a legal kind, then a legal cell of it, each equally likely."""
        kind = draw_legal(mask.max(axis=1), rng)
        return np.array([kind, draw_legal(mask[kind], rng)], np.int64)


class ContinuousActions(FactoredActions):
    """A point: three numbers in -1..1, the kind of action, the row and the column of its cell.

    Each number's range is divided evenly: by G kinds, and by the H rows and W columns of the
    representation `planes`. A point whose kind has no action at its cell plays the no-op. The mask
    is that of factored actions. Raises ValueError as `FactoredActions`, or if no action points at a
    cell.
    """

    dtype_kinds: ClassVar[str] = "f"
    numbers: ClassVar[str] = "numbers in -1..1"

    def __init__(self, game: str, spec: GameSpec) -> None:
        super().__init__(game, spec)
        if (np.asarray(spec.action_cells) == NO_CELL).all():
            raise ValueError(
                f"{game}: none of the actions points at a cell, so they are no points; leave out "
                "action_form"
            )
        rows, columns = spec.representations["planes"].shape[-2:]
        self.sizes = np.array([self.mask_shape[0], rows, columns])

    def to_engine(self, actions: NDArray[Any], player: int) -> NDArray[np.int64]:
        """The flat action [B] of each point float [B, 3]; the no-op where there is none."""
        wrong = np.argwhere(~(np.abs(actions) <= 1.0))  # NaN too
        if len(wrong):
            world, axis = wrong[0].tolist()
            raise ValueError(
                f"{self._game}: the {('kind', 'row', 'column')[axis]} {actions[world, axis]} of "
                f"player {player} in world {world} is outside -1..1"
            )
        places = ((actions.astype(np.float64) + 1.0) / 2.0 * self.sizes).astype(np.int64)
        kind, row, column = np.minimum(places, self.sizes - 1).T
        return self._flatten(kind, row * self.sizes[2] + column)

    def draw(self, mask: NDArray[np.int8], rng: np.random.Generator) -> NDArray[np.float32]:
        """The centre of a legal kind and cell, drawn as factored actions are."""
        kind, cell = super().draw(mask, rng)
        place = np.array([kind, *divmod(int(cell), int(self.sizes[2]))])
        centre: NDArray[np.float32] = ((2 * place + 1) / self.sizes - 1).astype(np.float32)
        return centre


ACTION_FORMS: dict[str, type[FlatActions]] = {
    "flat": FlatActions,
    "factored": FactoredActions,
    "continuous": ContinuousActions,
}


def make_action_form(name: str, game: str, spec: GameSpec) -> FlatActions:
    """A form by name for a scenario. Raises UnknownNameError, and ValueError as the form."""
    return find_by_name(f"{game} action form", name, ACTION_FORMS)(game, spec)
