"""What a minute of a person is worth, by the kind of question: no training at all.

`python -m studies.answer_kinds` has a simulated person answer pairs, rankings of four
clips, ratings of 1 to 5, pairs with a reason and pairs with a strength, and lets what
is believed then choose among fresh clips. A figure is the share of
`studies.few_answers`: what the twentieth of the fresh clips that it likes best is truly
worth, from 0 of the mean clip to 1 of the truly best twentieth, in the mean over the
commands.

Decided before looking:

- A pair takes a person 6 s, a ranking of four 14 s, a rating 4 s, a pair with a reason
  7 s, a pair with a strength 6 s. That is assumed.
- Every clip is perceived anew in each question, with an error of 0.3 deviations over
  clips of its command. The person ranks what was perceived, prefers the better of two,
  and rates by fifths of all clips of the command, which is kind to ratings: nobody
  knows them before the first question.
- The reason is right in four of five. Less than 0.25 deviations of perceived lead are
  "equally good", from 1 on "much better".
- Likelihoods: Bradley-Terry, Plackett-Luce, and of a rating the share of sixteen other
  clips of the command that it beats, in ordered logits; a share of the answers is
  random in all of them, as the posterior believes. Reasons and strengths have those
  of the product.
- Questions are chosen alike for all kinds: at random, or as the one of 150 whose answer
  the particles disagree about most (mutual information, BALD); reason and strength are
  not foreseen there.
- A kind is built into the page if, where questions are chosen, its share is above that
  of pairs by more than the standard error of the difference, in the mean over 60, 120
  and 240 s, over tasks and seeds; and not below it at random questions.

Shapes: N particles, A opinions, C clips, K candidates, Q answers.
"""

from __future__ import annotations

import itertools
import json
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, get_args

import numpy as np
import torch
import tyro
from torch import Tensor

from benchmarks.preference_plan import ABOUT, TASKS
from data.answers.answer_records import ASPECTS, Aspect
from gaitpref.method.method import STYLE
from gaitpref.raters.criteria import load_criterion
from gaitpref.raters.criterion_scores import criterion_context, score_of_criterion
from gaitpref.raters.error_model import said_why
from gaitpref.raters.rater_cfg import RaterCfg
from policy.robots.shipped import WALK
from policy.training.checkpoint import load_policy
from rewardmodel.answers.clip_batch import ClipBatch
from rewardmodel.answers.likelihood import Errors
from rewardmodel.descriptors.normaliser import fill_missing
from rewardmodel.descriptors.table import describe
from rewardmodel.opinions.aspects import UNSAID
from rewardmodel.opinions.opinions import Opinions
from rewardmodel.opinions.pool import Pool
from rewardmodel.posterior.hypotheses import Hypotheses, Prior, drawn
from rewardmodel.posterior.sampler import Answers, after_moves, effective, resampled

from .few_answers import FewAnswers, Recording, recordings, share_of_best

Kind = Literal["pairs", "rankings", "ratings", "reasons", "strengths"]
KINDS: tuple[Kind, ...] = get_args(Kind)
SECONDS: dict[Kind, float] = {
    "pairs": 6.0,
    "rankings": 14.0,
    "ratings": 4.0,
    "reasons": 7.0,
    "strengths": 6.0,
}
CLIPS: dict[Kind, int] = {
    "pairs": 2,
    "rankings": 4,
    "ratings": 1,
    "reasons": 2,
    "strengths": 2,
}
STRENGTHS = ((0.25, 0.5), (1.0, 0.75), (math.inf, 1.0))
"""Perceived lead in deviations below which an answer has that target."""
BUDGETS_S = (60.0, 120.0, 240.0)
PERCEIVED = 0.3
"""Error of perception, in deviations over clips of one command."""
ANCHORS = 16
"""Clips that a rated one is compared with in the likelihood."""
CANDIDATES = 150
LEVELS = 5
_CUTS = torch.tensor([math.log(k / (LEVELS - k)) for k in range(1, LEVELS)])
"""Logits of the shares at which a rating becomes the next."""
_BEND = 3.0
"""How sharp these are."""


@dataclass(frozen=True, kw_only=True)
class AnswerKinds:
    """Ask in each kind, learn, choose."""

    base: Path = WALK
    """Walking policy."""
    work: Path = Path("runs/few-answers")
    """Directory of the recordings."""
    tasks: tuple[str, ...] = ("high_step", "crouch", "low_energy", "smooth", "trot")
    """Wishes, by their names in `benchmarks.preference_plan`."""
    seeds: tuple[int, ...] = (101, 102, 103, 104)
    """Seeds of questions, perception and particles."""
    particles: int = 1000
    """N."""
    scale_error: float = 0.0
    """Error of where a person's scale of ratings lies, once for each person and
    command, in deviations over clips of the command. Thought of after looking."""
    kinds: tuple[Kind, ...] = KINDS
    """Kinds that are asked."""


@dataclass(frozen=True, eq=False)
class Given(Answers):
    """Answers of one kind: of each so many leads, the columns of `difference`."""

    kind: Kind = "pairs"
    level: Tensor = field(default_factory=lambda: torch.zeros(0))
    """[Q] ratings, what reasons name, targets of strengths; the best clip of a pair and
    the clips of a ranking come in order."""

    def part(self, rows: Tensor) -> Given:
        """Some of them."""
        width = WIDTH[self.kind]
        columns = (rows[:, None] * width + torch.arange(width)).flatten()
        return given(self.difference[:, columns], self.kind, self.level[rows])

    def log_likelihood(self, leads: Tensor, error_share: Tensor) -> Tensor:
        """[N] of all answers."""
        if self.kind == "strengths":
            return super().log_likelihood(leads, error_share)
        of_each = leads.unflatten(1, (-1, WIDTH[self.kind]))
        log_p = log_outcome(of_each, self.kind, self.level)
        error = error_share[:, :1]
        mixed = (1 - error) * log_p.exp() + error / OUTCOMES[self.kind]
        return mixed.clamp_min(1e-12).log().sum(dim=1)


WIDTH: dict[Kind, int] = {
    "pairs": 1,
    "rankings": 6,
    "ratings": ANCHORS,
    "reasons": 1,
    "strengths": 1,
}
OUTCOMES: dict[Kind, int] = {
    "pairs": 2,
    "rankings": 24,
    "ratings": LEVELS,
    "reasons": 2,
    "strengths": 2,
}
_ORDERED = tuple(itertools.combinations(range(4), 2))
"""Better and worse clip of the six leads of a ranking."""


def log_outcome(leads: Tensor, kind: Kind, level: Tensor) -> Tensor:
    """[N, Q] logarithm of how probable answers are that are meant, from leads
    [N, Q, width]."""
    if WIDTH[kind] == 1:
        return torch.nn.functional.logsigmoid(leads[..., 0])
    if kind == "rankings":
        total = torch.zeros(leads.shape[:2])
        for first in range(3):
            own = [n for n, (better, _) in enumerate(_ORDERED) if better == first]
            total -= torch.log1p((-leads[..., own]).exp().sum(dim=-1))
        return total
    beaten = leads.sigmoid().mean(dim=-1).clamp(0.01, 0.99)
    above = (_BEND * (beaten.logit()[..., None] - _CUTS)).sigmoid()  # [N, Q, 4]
    one, none = torch.ones_like(above[..., :1]), torch.zeros_like(above[..., :1])
    share = torch.cat([one, above], -1) - torch.cat([above, none], -1)
    index = level.long()[None, :, None].expand(*share.shape[:2], 1)
    return share.gather(-1, index)[..., 0].clamp_min(1e-9).log()


def given(difference: Tensor, kind: Kind, level: Tensor) -> Given:
    """Answers whose leads are in `difference` [A, Q * width]."""
    count = difference.shape[1] // WIDTH[kind]
    threshold = STYLE.reward.tie_threshold if kind == "strengths" else 0.0
    return Given(
        difference=difference,
        fall_lead=torch.zeros(count),
        target=level if kind == "strengths" else torch.ones(count),
        errors=Errors.alike(0.1, count, tie_threshold=threshold),
        aspect=level.long() if kind == "reasons" else torch.full((count,), UNSAID),
        tie_threshold=threshold,
        kind=kind,
        level=level,
    )


def columns_of(worth: Tensor, clips: Tensor, anchors: Tensor, kind: Kind) -> Tensor:
    """[..., Q * width] leads of answers about clips [Q, k], best first, where `worth`
    [..., C] is what is thought of each."""
    if kind == "ratings":
        found = worth[..., clips[:, :1]] - worth[..., anchors]
    else:
        places = _ORDERED if kind == "rankings" else ((0, 1),)
        better = clips[:, [one for one, _ in places]]
        worse = clips[:, [other for _, other in places]]
        found = worth[..., better] - worth[..., worse]
    return found.flatten(-2)


class Asked:
    """One person, one kind of question, until the time is up."""

    def __init__(
        self,
        kind: Kind,
        *,
        chosen: bool,
        opinions: Opinions,
        worth: Tensor,
        truth: np.ndarray,
        command: np.ndarray,
        seed: int,
        particles: int,
        about: Aspect,
        scale_error: float = 0.0,
    ) -> None:
        """
        Args:
            kind: Of the questions.
            chosen: Whether they are chosen, or drawn.
            opinions: What can be thought.
            worth: [A, C] what each opinion thinks of the clips.
            truth: [C] what they are worth to the person.
            command: [C] what was told in each.
            seed: Of everything.
            particles: N.
            about: What a reason names if it is right.
            scale_error: Of ratings.
        """
        self.kind: Kind = kind
        self.chosen = chosen
        self.opinions, self.worth, self.truth = opinions, worth, truth
        self.command = command
        self.rater = RaterCfg(why=about)
        self.rng = np.random.default_rng([seed, KINDS.index(kind), chosen])
        self.generator = torch.Generator().manual_seed(seed)
        self.prior = Prior()
        self.found = drawn(opinions, self.prior, particles, self.generator)
        self.log_weight = torch.zeros(particles)
        self.answers: Given | None = None
        self.spread = np.ones(len(truth))
        for told in np.unique(command):
            own = command == told
            self.spread[own] = truth[own].std()
        scale = np.random.default_rng([seed, 7])
        self.shift = {told: scale_error * scale.normal() for told in np.unique(command)}

    def ask(self) -> None:
        """One question more, its answer, and what is believed then."""
        clips, anchors = self._question()
        perceived = self.truth[clips] + PERCEIVED * self.spread[
            clips
        ] * self.rng.standard_normal(len(clips))
        ordered = torch.from_numpy(clips[np.argsort(-perceived)])[None]
        level = torch.zeros(1)
        if self.kind == "ratings":
            others = self.truth[self.command == self.command[clips[0]]]
            told_in = self.command[clips[0]]
            seen = perceived[0] + self.shift[told_in] * self.spread[clips[0]]
            share = float((others < seen).mean())
            level[0] = min(LEVELS - 1, int(LEVELS * share))
        elif self.kind == "reasons":
            level[0] = ASPECTS.index(said_why(self.rater, self.rng))
        elif self.kind == "strengths":
            lead = float(np.ptp(perceived)) / self.spread[clips[0]]
            level[0] = next(target for below, target in STRENGTHS if lead < below)
        told = torch.from_numpy(anchors)[None]
        new = given(columns_of(self.worth, ordered, told, self.kind), self.kind, level)
        self._learn(new)

    def liked(self, worth: Tensor) -> np.ndarray:
        """[C'] what is believed of other clips, of which opinions think [A, C']."""
        found = self.found
        leads = found.leads(self.opinions, worth) / found.sharpness[:, None]
        return (self.log_weight.softmax(0) @ leads).numpy()

    def _learn(self, new: Given) -> None:
        leads = self.found.leads(self.opinions, new.difference)
        self.log_weight = self.log_weight + new.log_likelihood(
            leads, self.found.error_share
        )
        self.log_weight = self.log_weight + new.log_about(self.found, self.opinions)
        before = self.answers
        self.answers = (
            new
            if before is None
            else given(
                torch.cat([before.difference, new.difference], 1),
                self.kind,
                torch.cat([before.level, new.level]),
            )
        )
        if effective(self.log_weight) < 0.6 * len(self.found):
            self.found = self.found[resampled(self.log_weight, self.generator)]
            self.log_weight = torch.zeros(len(self.found))
            self.found = after_moves(
                self.found, self.opinions, self.prior, self.answers, self.generator
            )

    def _question(self) -> tuple[np.ndarray, np.ndarray]:
        """Clips [k] of one command, and anchors [ANCHORS] of it."""
        drawn_ones = [self._draw() for _ in range(CANDIDATES if self.chosen else 1)]
        if not self.chosen:
            return drawn_ones[0]
        clips = torch.from_numpy(np.stack([clips for clips, _ in drawn_ones]))
        anchors = torch.from_numpy(np.stack([anchors for _, anchors in drawn_ones]))
        some = self.found[resampled(self.log_weight, self.generator)[::4]]
        best = int(self._disagreement(some, clips, anchors).argmax())
        return drawn_ones[best]

    def _draw(self) -> tuple[np.ndarray, np.ndarray]:
        told = self.rng.choice(np.unique(self.command))
        own = np.flatnonzero(self.command == told)
        many = self.rng.choice(own, CLIPS[self.kind] + ANCHORS, replace=False)
        return many[: CLIPS[self.kind]], many[CLIPS[self.kind] :]

    def _disagreement(
        self, found: Hypotheses, clips: Tensor, anchors: Tensor
    ) -> Tensor:
        """[K] mutual information of each question's answer with the wish."""
        worth = found.leads(self.opinions, self.worth)  # [N, C]
        outcomes: list[Tensor] = []
        if self.kind == "ratings":
            leads = columns_of(worth, clips, anchors, self.kind)
            each = leads.unflatten(1, (-1, ANCHORS))
            for level in range(LEVELS):
                every = torch.full((len(clips),), float(level))
                outcomes.append(log_outcome(each, self.kind, every))
        else:
            for order in itertools.permutations(range(clips.shape[1])):
                leads = columns_of(worth, clips[:, list(order)], anchors, self.kind)
                each = leads.unflatten(1, (-1, WIDTH[self.kind]))
                outcomes.append(log_outcome(each, self.kind, torch.zeros(len(clips))))
        p = torch.stack(outcomes).exp()  # [outcomes, N, K]
        error = found.error_share[None, :, :1]
        p = ((1 - error) * p + error / len(p)).clamp_min(1e-9)
        mean = p.mean(dim=1)
        return (p * p.log()).sum(dim=0).mean(dim=0) - (mean * mean.log()).sum(dim=0)


def worth_of_batch(pool: Pool, batch: ClipBatch) -> Tensor:
    """[A, C] what each opinion thinks of clips."""
    steps = fill_missing(pool.normaliser(describe(batch.features, "legs")))
    occupied = pool.occupancy_of(steps, batch.scored, batch.lift_offs_before)
    return pool.opinions.worth(occupied)


def pool_of(recording: Recording) -> Pool:
    """What opinions are about."""
    recorded = recording.pool
    assert recorded is not None
    clips = recorded.clips
    return Pool(
        describe(clips.features, "legs"),
        clips.scored,
        clips.lift_offs_before,
        recorded.command,
        told=False,
    )


def main(cfg: AnswerKinds) -> None:
    """Print a line of JSON for each wish, seed, kind and way to choose, and a table."""
    torch.set_num_threads(1)
    few = FewAnswers(base=cfg.base, work=cfg.work)
    asked_of, fresh = recordings(few)
    pool = pool_of(asked_of)
    standing = torch.from_numpy(np.flatnonzero(~asked_of.batch.fell.numpy()))
    worth = worth_of_batch(pool, asked_of.batch)[:, standing]
    fresh_worth = worth_of_batch(pool, fresh.batch)
    policy = load_policy(cfg.base)
    context = criterion_context(policy.robot(), policy.info.env)
    shares: dict[tuple[Kind, bool], list[list[float]]] = {}
    for task, seed in itertools.product(cfg.tasks, cfg.seeds):
        score = score_of_criterion(load_criterion(TASKS[task], context))
        true, true_fresh = asked_of.worth(score), fresh.worth(score)
        truth = np.array([true[c.rollout][c.rows].mean() for c in asked_of.clips])
        aim = np.array([true_fresh[c.rollout][c.rows].mean() for c in fresh.clips])
        for kind, chosen in itertools.product(cfg.kinds, (False, True)):
            person = Asked(
                kind,
                chosen=chosen,
                opinions=pool.opinions,
                worth=worth,
                truth=truth[standing.numpy()],
                command=asked_of.command[standing.numpy()],
                seed=seed,
                particles=cfg.particles,
                about=ABOUT[task],
                scale_error=cfg.scale_error,
            )
            row = _shares(person, fresh_worth, aim, fresh.command)
            shares.setdefault((kind, chosen), []).append(row)
            told = {"task": task, "seed": seed, "kind": kind, "chosen": chosen}
            print(json.dumps({**told, "shares": row}), flush=True)
    for line in table(shares):
        print(line)


def _shares(
    person: Asked, fresh: Tensor, aim: np.ndarray, command: np.ndarray
) -> list[float]:
    """The share after each budget."""
    found, asked = [], 0
    for budget_s in BUDGETS_S:
        while (asked + 1) * SECONDS[person.kind] <= budget_s:
            person.ask()
            asked += 1
        share = share_of_best(person.liked(fresh), aim, command)
        found.append(round(share, 3))
    return found


def table(shares: dict[tuple[Kind, bool], list[list[float]]]) -> list[str]:
    """A line for each kind and way to choose, with the difference to pairs."""
    lines = []
    for (kind, chosen), rows in shares.items():
        own = np.array(rows)
        pairs = np.array(shares.get(("pairs", chosen), rows))
        each = (own - pairs).mean(axis=1)
        error = each.std(ddof=1) / math.sqrt(len(each)) if len(each) > 1 else math.nan
        budgets = " ".join(f"{share:.3f}" for share in own.mean(axis=0))
        lines.append(
            f"{kind:<9} {'chosen' if chosen else 'random'}: {budgets}; beside pairs "
            f"{each.mean():+.3f} ± {error:.3f} ({len(each)} runs)"
        )
    return lines


if __name__ == "__main__":
    main(tyro.cli(AnswerKinds))
