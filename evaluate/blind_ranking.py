"""`python -m evaluate.blind_ranking ANSWERS ...`: rank methods by the answers of people to blind.html."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from numpy.typing import NDArray

from uvcloth.errors import InputError
from uvcloth.files.json_file import read_json
from uvcloth.files.options import parsed
from uvcloth.process.command import run_command

from .blind import FORMAT
from .candidates import SIMULATION

WINS = {"left": 1.0, "right": 0.0, "neither": 0.5}
"""Share of a win of the left side, by answer."""

RESAMPLES, LEVEL = 300, 0.95
"""Number of resampled rankings, and the share of them that is in an interval."""

PRIOR = 10.0
"""Variance of strengths before any answer, log odds: a method that never lost has no other limit."""


@dataclass(frozen=True)
class Vote:
    """One pair. left: share of a win of the left side. person: that answered."""

    left: str
    right: str
    won: float
    person: int


@dataclass(frozen=True)
class Ranked:
    """A method. strength: log odds against the mean of all. low, high: its interval. pairs: it was in."""

    method: str
    strength: float
    low: float
    high: float
    pairs: int


def read_answers(paths: Sequence[Path]) -> list[Vote]:
    """Read saved answers, a file for each person. Raises InputError naming a file of another kind."""
    answers = []
    for person, path in enumerate(paths):
        content = read_json(path, "answers saved by blind.html")
        given = content.get("answers") if isinstance(content, dict) else None
        if not isinstance(given, list) or content.get("format") != FORMAT:
            raise InputError(f"{path}: expected answers saved by blind.html ({FORMAT})")
        for each in given:
            if (
                not isinstance(each, dict)
                or not {"left", "right", "answer"} <= set(each)
                or each["answer"] not in WINS
            ):
                raise InputError(f"{path}: expected answers of left, right or neither, not {each!s:.60}")
            answers.append(Vote(str(each["left"]), str(each["right"]), WINS[each["answer"]], person))
    if not answers:
        raise InputError(f"{paths[0]}: holds no answer")
    return answers


def rank(answers: Sequence[Vote]) -> list[Ranked]:
    """Methods by their strength in the model of Bradley and Terry (1952), the best first.

    Intervals are from resampled people, or from resampled answers where one person gave them all; an answer
    of neither is half a win for both.
    """
    names = sorted(set(chain.from_iterable((each.left, each.right) for each in answers)))
    people = [answer.person for answer in answers]
    units = people if len(set(people)) > 1 else list(range(len(answers)))
    # Wins of one method over another, for each unit that is resampled.
    wins = np.zeros((max(units) + 1, len(names), len(names)))
    for unit, each in zip(units, answers, strict=True):
        left, right = names.index(each.left), names.index(each.right)
        wins[unit, left, right] += each.won
        wins[unit, right, left] += 1.0 - each.won
    generator = np.random.default_rng(0)
    drawn = [strengths(wins[generator.integers(len(wins), size=len(wins))].sum(0)) for _ in range(RESAMPLES)]
    outer = 50.0 * (1.0 - LEVEL)
    low, high = np.percentile(drawn, [outer, 100.0 - outer], axis=0)
    total = wins.sum(0)
    best, pairs = strengths(total), total.sum(0) + total.sum(1)
    ranked = [
        Ranked(name, float(best[k]), float(low[k]), float(high[k]), round(pairs[k]))
        for k, name in enumerate(names)
    ]
    return sorted(ranked, key=lambda each: -each.strength)


def strengths(wins: NDArray[np.float64]) -> NDArray[np.float64]:
    """Strengths (K,), log odds with mean 0, from wins (K, K) of one method over another.

    A logistic regression on the difference of both, whose samples are wins and losses with their weights.
    """
    from sklearn.linear_model import LogisticRegression

    winners, losers = np.nonzero(wins)
    each = np.eye(len(wins))
    signs = each[winners] - each[losers]
    weights = np.tile(wins[winners, losers] / 2.0, 2)
    model = LogisticRegression(C=PRIOR, fit_intercept=False)
    # The same samples the other way round: a win of one is a loss of the other.
    model.fit(np.concatenate([signs, -signs]), np.repeat([1, 0], len(signs)), sample_weight=weights)
    strength: NDArray[np.float64] = model.coef_[0]
    return strength - strength.mean()


def table(ranked: Sequence[Ranked]) -> str:
    """The ranking in words, with the share of answers that would prefer a method to the simulation."""
    true = next((each.strength for each in ranked if each.method == SIMULATION), None)
    wide = max(len(each.method) for each in ranked)
    lines = [f"{'':{wide}}  strength, interval    pairs  preferred to the simulation"]
    for each in ranked:
        share = "" if true is None else f"{100.0 / (1.0 + np.exp(true - each.strength)):.0f} %"
        beside = "" if each.method == SIMULATION else share
        interval = f"{each.low:+.2f} … {each.high:+.2f}"
        lines.append(
            f"{each.method:{wide}}  {each.strength:+.2f}, {interval:15} {each.pairs:5}  {beside}".rstrip()
        )
    return "\n".join(lines)


@dataclass(frozen=True)
class BlindRanking:
    """Rank methods by answers to blind.html (Bradley-Terry), with intervals."""

    answers: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Files that the page saved, one for each person."""

    def run(self) -> None:
        """Print the ranking. Raises InputError for a file that holds no answers."""
        print(table(rank(read_answers(self.answers))))


def main(arguments: Sequence[str] | None = None) -> int:
    """Parse the command line and rank; returns the exit code: 0, 2 for bad input."""
    given = sys.argv[1:] if arguments is None else arguments

    def rank_answers() -> None:
        parsed(
            lambda: tyro.cli(BlindRanking, args=given, prog="python -m evaluate.blind_ranking"), given
        ).run()

    return run_command("blind_ranking", rank_answers)


if __name__ == "__main__":
    sys.exit(main())
