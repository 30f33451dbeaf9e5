"""A reward for all answers so far."""

from __future__ import annotations

import json
from dataclasses import asdict

from data.datasets.dataset import Dataset
from data.datasets.gone import told_gone
from data.files.files import write_atomically
from gaitpref.console.progress import console, counting_bar
from gaitpref.method.context import RoundContext
from gaitpref.method.noisy import NoisyAnswers
from gaitpref.report.fit_summary import fit_summary
from rewardmodel.answers.answered_pairs import load_pairs
from rewardmodel.fitting.fit_reward import fit_reward, models_fitted, no_reward
from rewardmodel.models.storage import save_reward

from .loop_cfg import LoopCfg
from .people import People
from .run_dir import Round, decided_before, place_of, seed_of


def fit_stage(
    cfg: LoopCfg,
    round: Round,
    context: RoundContext,
    dataset: Dataset,
    people: People,
) -> None:
    """Fit a reward to all answers so far; where they prefer too little, it is 0.

    The first reward of a run decides whether its answers err.
    """
    if round.reward.exists():
        return
    people.tell(f"{place_of(cfg, round)}: learning from the answers")
    pairs = load_pairs([dataset], at_least=0, unchecked=cfg.unchecked)
    settings = cfg.method.fit_of(context)
    if pairs.too_little:
        model, _ = no_reward(pairs, settings)
        told = f"{pairs.too_little}: it is 0"
    else:
        seed = seed_of(cfg, round.number, 5)
        title = f"round {round.number}: fitting to {len(pairs)} answers, models"
        with counting_bar(title, models_fitted(settings)) as bar:
            model, report = fit_reward(
                pairs,
                settings,
                seed=seed,
                advance=lambda: bar.advance(bar.task_ids[0]),
            )
        told = fit_summary(report)
        if not decided_before(round):
            decided = NoisyAnswers.of(model)
            text = json.dumps({**asdict(decided), "told": str(decided)})
            write_atomically(round.decided, text.encode())
            told = f"{told}; {decided}"
    save_reward(model, round.reward)
    console.print(f"round {round.number}: {told}")
    for told in pairs.left_out.told:
        console.print(f"round {round.number}: answers: {told}")
    if gone := told_gone(pairs.num_gone, pairs.num_collected, dataset.root):
        console.print(f"round {round.number}: {gone}")
