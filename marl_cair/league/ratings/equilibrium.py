"""Maximum-entropy Nash equilibria and maximin mixtures of two-player zero-sum games."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog, minimize
from scipy.special import logsumexp, softmax

_TOLERANCE = 1e-9  # of a game's largest payoff
_PLAYS = 1e-7  # a share, or a loss, that is surely above 0
_LOSES = 1e-5  # a loss against an equilibrium that a program found, to its tolerance
_FEW = 12  # rows of a first, small program


def exploitability(payoff: NDArray[np.float64], mixture: NDArray[np.float64]) -> float:
    """The best row's gain against `mixture` [K] in the antisymmetric `payoff` [K, K]."""
    return float((payoff @ mixture).max()) if len(mixture) else 0.0


def maximum_entropy_nash(payoff: NDArray[np.float64]) -> NDArray[np.float64]:
    """The unique equilibrium [K] of highest entropy (Balduzzi et al. 2018, "Re-evaluating
    evaluation").

    payoff: float64 [K, K], the row's gain against the column, antisymmetric. Linear programs find
    the rows that play in some equilibrium; over them the mixture of highest entropy is
    softmax(payoff @ multipliers), which minimises its dual.

    Raises:
        ValueError: not square, not antisymmetric, or not finite.
    """
    if payoff.ndim != 2 or payoff.shape[0] != payoff.shape[1]:
        raise ValueError(f"payoffs have shape {list(payoff.shape)}, they must be [K, K]")
    if not np.isfinite(payoff).all():
        raise ValueError("payoffs must be finite numbers")
    if not np.allclose(payoff, -payoff.T, atol=1e-8):
        raise ValueError(
            "payoffs are not antisymmetric (the row's gain is the column's loss): subtract the "
            "payoff of an even game"
        )
    scale = float(np.abs(payoff).max()) if len(payoff) else 0.0
    if scale == 0.0:
        return np.full(len(payoff), 1.0 / max(1, len(payoff)))
    matrix = payoff / scale
    near = _find_any_equilibrium(matrix)
    if (sole := _find_sole_equilibrium(matrix, near)) is not None:
        return sole
    inner = _find_inner_equilibrium(matrix, near)
    # Highest entropy where the rows that play gain 0 and no other row gains.
    plays = inner > _PLAYS
    spread = np.zeros(len(matrix))
    bounds = [(None if row else 0.0, None) for row in plays]
    spread[plays] = _find_most_even(-matrix[:, plays].T, bounds)
    # Where the dual does not converge, the mean of the programs' corners is an equilibrium too.
    return spread if exploitability(matrix, spread) <= 1e-6 else inner


def find_safest_mixture(scores: NDArray[np.float64], slack: float) -> NDArray[np.float64]:
    """The most even mixture [K] of rows whose least score against a column is within `slack` of the
    highest least score that any mixture has.

    scores: float64 [K, N] of rows against columns. A linear program gives the highest least score;
    among the mixtures near it the one of highest entropy is softmax(scores @ multipliers). Without
    slack, rows would be left out for differences that games cannot show.

    Raises:
        ValueError: no row or column, scores that are not finite, or a slack that is not above 0.
        ArithmeticError: the solver fails.
    """
    if scores.ndim != 2 or not scores.size or not np.isfinite(scores).all():
        raise ValueError(f"scores have shape {list(scores.shape)}, they must be finite, [K, N]")
    if not slack > 0.0:
        raise ValueError(f"slack is {slack}, it must be above 0")
    num_rows, num_columns = scores.shape
    found = _run_program(
        np.append(np.zeros(num_rows), -1.0),
        A_ub=np.column_stack([-scores.T, np.ones(num_columns)]),
        b_ub=np.zeros(num_columns),
        A_eq=[[1.0] * num_rows + [0.0]],
        bounds=[(0.0, None)] * num_rows + [(None, None)],
    )
    above = scores - (float(found[-1]) - slack)
    mixture = _find_most_even(above, [(0.0, None)] * num_columns)
    if (mixture @ above).min() >= -1e-3 * slack:
        return mixture
    corner = np.maximum(found[:-1], 0.0)
    return np.asarray(corner / corner.sum(), np.float64)


def _run_program(costs: NDArray[np.float64], **limits: Any) -> NDArray[np.float64]:
    """The solution of a linear program whose shares add up to 1."""
    found = linprog(costs, b_eq=[1.0], method="highs", **limits)
    if found.status != 0:
        raise ArithmeticError(f"the linear program of a mixture failed: {found.message}")
    return np.asarray(found.x, np.float64)


def _find_sole_equilibrium(
    matrix: NDArray[np.float64], near: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """The only equilibrium [K], as payoffs without ties have it; None where there may be others.
    near: it, to the tolerance of a program.

    It is the only one where each row either plays or loses against it, and no other mixture of
    those that play is even against them all (Kaplansky 1945, "A contribution to von Neumann's
    theory of games").
    """
    for least in (_PLAYS, 1e-5, 1e-3):  # the program allows a little gain, and so a little too much
        plays = near > least
        _, sizes, right = np.linalg.svd(matrix[np.ix_(plays, plays)])
        total = right[-1].sum()
        is_sole = len(sizes) == 1 or sizes[-2] > _PLAYS
        if sizes[-1] > _PLAYS or not is_sole or abs(total) < _PLAYS:
            continue
        mixture = np.zeros(len(matrix))
        mixture[plays] = right[-1] / total
        gain = matrix @ mixture
        if (mixture[plays] > _PLAYS).all() and (gain[~plays] < -_PLAYS).all():
            return mixture
    return None


def _find_any_equilibrium(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """The equilibrium of a program over the best rows, and those that gain against it, until none
    gains (McMahan, Gordon, Blum 2003, double oracle): most rows of a league play in no equilibrium.
    """
    rows = np.argsort(-matrix.sum(1), kind="stable")[:_FEW]
    while True:
        mixture = np.zeros(len(matrix))
        mixture[rows] = _solve(matrix[np.ix_(rows, rows)], np.zeros(len(rows)))
        gain = matrix @ mixture
        gain[rows] = 0.0  # but for rounding
        better = np.flatnonzero(gain > _TOLERANCE)
        if not len(better):
            return mixture
        best = better[np.argsort(-gain[better], kind="stable")[:_FEW]]
        rows = np.concatenate([rows, best])


def _solve(matrix: NDArray[np.float64], aim: NDArray[np.float64]) -> NDArray[np.float64]:
    """Shares [N] of columns against which no row of `matrix` [K, N] gains, of the smallest product
    with `aim` [N].
    """
    limits = {"A_ub": matrix, "b_ub": np.full(len(matrix), _TOLERANCE)}
    corner = np.maximum(_run_program(aim, A_eq=np.ones((1, len(aim))), **limits), 0.0)
    return np.asarray(corner / corner.sum(), np.float64)


def _find_inner_equilibrium(
    matrix: NDArray[np.float64], near: NDArray[np.float64]
) -> NDArray[np.float64]:
    """An equilibrium [K] in which every row plays that plays in any: the mean of those in which
    each row in turn plays as much as it can. near: some equilibrium.
    """
    # A row that loses against one equilibrium plays in none. The programs stay over all columns:
    # without the others' last tiny shares there may be no mixture within the tolerance.
    seen = matrix @ near < -_LOSES
    corners = []
    for place, aim in enumerate(-np.eye(len(matrix))):
        if not seen[place]:
            corners.append(_solve(matrix, aim))
            seen |= corners[-1] > _PLAYS
    inner = np.mean(corners, axis=0)
    return np.asarray(inner / inner.sum(), np.float64)


def _find_most_even(
    above: NDArray[np.float64], bounds: Sequence[tuple[float | None, float | None]]
) -> NDArray[np.float64]:
    """The mixture [K] of highest entropy of which `mixture @ above` is 0 in each column [N] whose
    multiplier is free, and 0 or more where it is bounded below by 0: above [K, N]. Another one, if
    there is none or the dual does not converge: the caller must test it.
    """

    def dual(multipliers: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        logits = above @ multipliers
        return float(logsumexp(logits)), above.T @ softmax(logits)

    found = minimize(
        dual,
        np.zeros(above.shape[1]),
        jac=True,
        bounds=bounds,
        method="L-BFGS-B",
        options={"maxiter": 5_000, "maxfun": 20_000, "ftol": 0.0, "gtol": 1e-10},
    )
    return np.asarray(softmax(above @ found.x), np.float64)
