"""What answers say of new policies, and which one a run ends with."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial

from data.datasets.dataset import Dataset
from data.files.files import read_file, read_json, replace_directory, write_atomically
from data.files.limits import POLICY_BYTES
from gaitpref.console.progress import console
from gaitpref.method.acceptance import LEAST_LAST, SURE, Compared, Duel
from gaitpref.method.context import RoundContext
from gaitpref.method.method import Method
from gaitpref.method.unstick import Optimism
from gaitpref.raters.criteria import Criterion
from gaitpref.report.verdict import Verdict
from policy.training.checkpoint import load_policy
from policy.training.training_dir import POLICY_NAME

from .collect import Collector
from .loop_cfg import LoopCfg
from .people import People
from .run_dir import Round, began_from, seed_of
from .show_stage import duel_of, pairs_of_both, shown_by, to_compare
from .standstill import standing_of


def approval_stage(
    method: Method, round: Round, context: RoundContext, dataset: Dataset
) -> None:
    """What the round's answers say of its policy, where they were asked about it."""
    if round.approval.exists() or round.reward.exists() or method.accept is None:
        return
    compared = to_compare(method, round, context)
    if not compared:
        return
    new, old = compared
    duel = duel_of(round, dataset, new.sha256, old.sha256)
    shown = shown_by(round, dataset, new.sha256)
    approved = shown and method.accept.goes_on(duel)
    console.print(
        f"round {round.number}: the new policy is preferred to the one before in "
        f"{duel.for_new} of {duel.for_new + duel.for_old} answers"
        + ("" if approved else "; training goes on from the one before")
    )
    found = {**asdict(duel), "approved": approved}
    write_atomically(round.approval, json.dumps(found, indent=1).encode())


def verdict_stage(
    cfg: LoopCfg,
    round: Round,
    context: RoundContext,
    dataset: Dataset,
    criterion: Criterion,
    people: People,
) -> None:
    """Ask about the policy of the last round, which waits for it; it, the one it began
    from or the first of all stays."""
    accept = cfg.method.accept
    if accept is None:
        return
    if not round.verdict.exists():
        found = Verdict(stays=round.number, rounds=round.number)
        if round.candidate.exists():
            collector = partial(
                Collector,
                cfg=cfg,
                round=round,
                dataset=dataset,
                criterion=criterion,
                people=people,
            )
            contest = _Contest(
                round, dataset, cfg, collector, cfg.method.labels_kept(context)
            )
            found = contest.verdict(accept)
        found = _with_its_gait(found, cfg, round)
        text = json.dumps(found.as_json(), indent=1)
        write_atomically(round.verdict, text.encode())
    if round.policy.exists():
        return
    stays = read_json(round.verdict)["stays"]
    if stays == round.number:
        replace_directory(round.candidate, round.policy.parent)
        return
    unfinished = round.root / "policy.partial"
    shutil.rmtree(unfinished, ignore_errors=True)
    unfinished.mkdir()
    kept = read_file(Round(round.run, stays).policy, POLICY_BYTES)
    write_atomically(unfinished / POLICY_NAME, kept)
    replace_directory(unfinished, round.policy.parent)


def _with_its_gait(verdict: Verdict, cfg: LoopCfg, round: Round) -> Verdict:
    """`verdict`, with whether the policy from scratch that stays was made to stand, or
    learned to."""
    if not verdict.stays or cfg.base != "none":
        return verdict
    own = Round(round.run, verdict.stays)
    waits = own.candidate / POLICY_NAME
    policy = load_policy(waits if waits.exists() else own.policy)
    if policy.holds_home:
        return replace(verdict, stands=True)
    optimism = cfg.method.unstick or Optimism()
    standstill = standing_of(policy, optimism, seed=seed_of(cfg, round.number, 15))
    return replace(verdict, nowhere=str(standstill or ""))


@dataclass(eq=False)
class _Contest:
    """Duels of a run's policies, as long as answers are left for them."""

    round: Round
    dataset: Dataset
    cfg: LoopCfg
    collector: Callable[[], Collector]
    """Waits for the answers of one duel, each with as much patience."""
    left: int
    """Answers."""

    def verdict(self, accept: Compared) -> Verdict:
        """The last policy beside the one it began from, and who wins beside the first.

        The last one stays unless more answers prefer the one before, and what stays
        then unless the first is surely preferred: few answers that err had better not
        undo a whole run. One that no clip shows, as where every simulation of it
        diverges, does not stay.
        """
        round = self.round
        new, before, first = (
            load_policy(file).sha256
            for file in (
                round.candidate / POLICY_NAME,
                began_from(round),
                Round(round.run, 0).policy,
            )
        )
        stays, beside_before, beside_first = new, None, None
        most = self.left - LEAST_LAST
        if before not in (new, first) and most > 0:
            beside_before = self._duel(new, before, most=most, sure=accept.before_sure)
            preferred = beside_before.for_new >= beside_before.for_old
            stays = new if self._is_seen(new) and preferred else before
        if stays != first:
            beside_first = self._duel(stays, first, most=self.left, sure=SURE)
            lost = beside_first.is_lost(SURE)
            stays = stays if self._is_seen(stays) and not lost else first
        return Verdict(
            stays=self._round_of(stays),
            rounds=round.number,
            beside_first=beside_first,
            beside_before=beside_before,
        )

    def _duel(self, new: str, old: str, *, most: int, sure: float) -> Duel:
        """Ask about two policies until it is `sure` which is better, `most` times at
        most, or patience is over; what was asked before counts."""
        pairs = pairs_of_both(self.cfg, self.round, self.dataset, new, old)
        collector = self.collector()
        while True:
            with self.dataset.answers() as store:
                known = {pair.pair_id for pair in store.pairs()}
                own = store.pairs(round=self.round.number)
                asked = sum(pair in own for pair in pairs)
                open_ones = [pair for pair in pairs if pair.pair_id not in known]
            lasted = not asked or collector.answered(len(own), last=True)
            duel = duel_of(self.round, self.dataset, new, old)
            more = open_ones[: min(duel.least_more(sure), most - asked)]
            if not more or not lasted:
                self.left -= asked
                return duel
            with self.dataset.answers() as store:
                store.add_pairs(more)

    def _is_seen(self, policy: str) -> bool:
        return shown_by(self.round, self.dataset, policy)

    def _round_of(self, policy: str) -> int:
        """The first whose policy it is: of one that nothing was trained of, not the
        last."""
        earlier = (Round(self.round.run, number) for number in range(self.round.number))
        same = (r for r in earlier if load_policy(r.policy).sha256 == policy)
        return next(same, self.round).number
