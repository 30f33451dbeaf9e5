"""Which answers of some data sets teach which gait is better, and which do not."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from data.answers.answer_records import Answer, Pair, RaterKind, utc_text
from data.answers.curation import answers_heard
from data.answers.curation import left_out as unwanted_raters
from data.answers.rater_habits import Sides, sides_of
from data.answers.store import AnswerStore
from data.datasets.dataset import Dataset
from data.datasets.gone import listed_in

from .program_agreement import PROGRAM, Agreement, agreements, told_untaught


@dataclass(frozen=True)
class Used:
    """What a rater said of a pair, once."""

    pair: Pair
    rater_id: str
    target: float
    """Mean probability that the left clip is better, of one who was asked again."""
    created_utc: str = ""
    """When it was given, of several the last."""
    why: str = ""
    """What the answer was said to be about, where all of them say the same."""

    @property
    def line(self) -> str:
        """What is fitted of it: equal lines are the same evidence."""
        told = f"{self.pair.a.key} {self.pair.b.key} {self.rater_id} {self.target}"
        return f"{told} {self.why}" if self.why else told


@dataclass(frozen=True, kw_only=True)
class LeftOut:
    """Whose answers are there and teach nothing."""

    programs: tuple[Agreement, ...] = ()
    """Programs, as they do not agree with people."""
    raters: Mapping[str, int] = field(default_factory=dict)
    """Raters whom the owner leaves out, and how many answers each gave."""

    @property
    def told(self) -> list[str]:
        """A line for each of them."""
        told = [
            f"the {count} of {rater_id} are left out, as the owner says"
            for rater_id, count in self.raters.items()
        ]
        return told + [told_untaught(each) for each in self.programs]


@dataclass(frozen=True, kw_only=True)
class UsedAnswers:
    """The current answers of some data sets, and what of them a fit uses."""

    rows: tuple[Used, ...]
    """In an order that depends on the answers alone."""
    collected: int
    """Answers there are."""
    without_target: int
    """Answers that neither prefer a clip nor call both equal."""
    gone: int
    """Answers about an episode that no data set has any more."""
    sides: tuple[Sides, ...]
    """Which side of the screen each rater prefers."""
    left_out: LeftOut = LeftOut()
    """Whose answers teach nothing."""

    @property
    def preferences(self) -> int:
        """Number of answers that prefer a clip, as `count_preferences` counts them."""
        clips = [(row.pair.a.key, row.pair.b.key) for row in self.rows]
        return count_preferences(clips, [row.target for row in self.rows])


def answers_used(
    datasets: Sequence[Dataset], *, unchecked: bool = False
) -> UsedAnswers:
    """What `datasets` say; an answer found in several of them counts once.

    Args:
        datasets: Any number.
        unchecked: Take answers of programs too that do not agree with people.

    Raises:
        DatasetError, AnswerError: a manifest or the answers cannot be read.
    """
    answered, kinds, unwanted = _current_answers(datasets)
    listed = listed_in(datasets)
    here = [row for row in answered if listed(row[0])]
    gone = len(answered) - len(here)
    by_owner = Counter(a.rater_id for _, a in here if a.rater_id in unwanted)
    here = [row for row in here if row[1].rater_id not in unwanted]
    untaught = () if unchecked else _untaught(here, kinds)
    doubted = {each.rater_id for each in untaught}
    here = [row for row in here if row[1].rater_id not in doubted]
    return UsedAnswers(
        rows=tuple(evidence_of(here)),
        collected=len(answered),
        without_target=sum(answer.target is None for _, answer in here),
        gone=gone,
        sides=sides_of(answer for _, answer in here),
        left_out=LeftOut(programs=untaught, raters=dict(sorted(by_owner.items()))),
    )


def _untaught(
    rows: Sequence[tuple[Pair, Answer]], kinds: Mapping[str, RaterKind]
) -> tuple[Agreement, ...]:
    """Programs that answered, and may not teach."""
    if PROGRAM not in kinds.values():
        return ()
    answered = {answer.rater_id for _, answer in rows}
    return tuple(
        each
        for name, each in agreements(rows, kinds).items()
        if name in answered and not each.teaches
    )


def count_evidence(
    store: AnswerStore, dataset: Dataset | None = None, *, unchecked: bool = False
) -> int:
    """How many preferences of a store a fit would use, those left out that are about
    episodes which `dataset` lists no more, or of programs that may not teach."""
    listed = listed_in([] if dataset is None else [dataset])
    answered = answers_heard(store)
    here = [row for row in answered if dataset is None or listed(row[0])]
    untaught = () if unchecked else _untaught(here, store.raters())
    doubted = {each.rater_id for each in untaught}
    rows = evidence_of(row for row in here if row[1].rater_id not in doubted)
    clips = [(row.pair.a.key, row.pair.b.key) for row in rows]
    return count_preferences(clips, [row.target for row in rows])


def count_preferences(clips: Sequence[tuple[str, str]], targets: list[float]) -> int:
    """How many answers prefer a clip, without those that another answer takes back:
    as sure of the opposite, about the same two clips.

    Args:
        clips: What the left and the right clip of each answer are called.
        targets: Probability that the left one is better.
    """
    balance: Counter[tuple[tuple[str, ...], float]] = Counter()
    for pair, target in zip(clips, targets, strict=True):
        lead = target - 0.5 if pair[0] <= pair[1] else 0.5 - target
        balance[tuple(sorted(pair)), abs(lead)] += (lead > 0) - (lead < 0)
    return sum(abs(count) for count in balance.values())


def evidence_of(answered: Iterable[tuple[Pair, Answer]]) -> list[Used]:
    """Whatever teaches which gait is better, sorted."""
    targets: dict[tuple[str, str], list[float]] = defaultdict(list)
    whys: dict[tuple[str, str], set[str]] = defaultdict(set)
    times: dict[tuple[str, str], str] = {}
    pairs: dict[str, Pair] = {}
    for pair, answer in answered:
        target = answer.target
        if target is not None and pair.gold is None:
            pairs[pair.pair_id] = pair
            targets[pair.pair_id, answer.rater_id].append(target)
            whys[pair.pair_id, answer.rater_id] |= {answer.why} - {""}
            given = utc_text(answer.created_utc)
            last = times.get((pair.pair_id, answer.rater_id), given)
            times[pair.pair_id, answer.rater_id] = max(last, given)
    evidence = (
        Used(
            pairs[asked[0]],
            asked[1],
            sum(of_both) / len(of_both),
            times[asked],
            next(iter(whys[asked])) if len(whys[asked]) == 1 else "",
        )
        for asked, of_both in targets.items()
    )
    return sorted(evidence, key=lambda row: row.line)


def _current_answers(
    datasets: Sequence[Dataset],
) -> tuple[list[tuple[Pair, Answer]], dict[str, RaterKind], set[str]]:
    """Every current answer once, what the raters are, and whom an owner leaves out."""
    answers: dict[str, tuple[Pair, Answer]] = {}
    kinds: dict[str, RaterKind] = {}
    unwanted: set[str] = set()
    for dataset in datasets:
        with dataset.answers_copy() as store:
            programs = [name for name in kinds if kinds[name] == PROGRAM]
            kinds |= store.raters()
            # Whoever is a program in one of them is a person in none.
            kinds |= dict.fromkeys(programs, PROGRAM)
            unwanted |= unwanted_raters(store)
            for pair, answer in store.current_answers():
                answers[answer.answer_id] = (pair, answer)
    # A copy of a data set may not know that its answer was corrected elsewhere.
    corrected = {answer.supersedes for _, answer in answers.values()}
    rows = [row for row in answers.values() if row[1].answer_id not in corrected]
    return rows, kinds, unwanted
