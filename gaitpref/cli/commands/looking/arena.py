"""`gaitpref arena`: which of several policies people prefer."""

from __future__ import annotations

from collections.abc import Callable

from data.datasets.dataset import Dataset
from gaitpref.arena.arena import ArenaCfg, Standing, hold, record_arena
from gaitpref.arena.arena_page import write_arena_page
from gaitpref.arena.games import players_of
from gaitpref.cli.options import options
from gaitpref.cli.shared.rater_arguments import erring_rater
from gaitpref.console.browser import open_page
from gaitpref.console.progress import console, counted, counting_bar
from gaitpref.console.terminal import say
from gaitpref.raters.criteria import load_criterion
from gaitpref.raters.criterion_scores import context_of_dataset
from gaitpref.raters.simulated import answer_pairs
from gaitpref.report.verdict import play_command


def run(command: options.Arena) -> int:
    """Run the command; gives the exit code."""
    players = players_of(command.policy)
    cfg = ArenaCfg(episodes=command.episodes, most=command.most, seed=command.seed)
    answer = _simulated(command) if command.criterion else None
    with counted("recording, steps") as tell:
        record_arena(command.out, players, cfg, tell)
    with counting_bar("answers", cfg.most) as bar:
        standing = hold(
            command.out,
            players,
            cfg,
            answer,
            lambda done, _: bar.update(bar.task_ids[0], completed=done),
        )
    page = write_arena_page(command.out, standing)
    say(f"{standing.sentence}; the page is {page}")
    if command.open:
        open_page(page.resolve().as_uri())
    if standing.open_questions:
        say(_asked(command, standing))
        return 0
    best, second = (players[n] for n in standing.ranking.order[:2])
    shown = f"`{play_command(best.file, second.file)}` shows the first two"
    console.next(shown if standing.ranking.is_sure else f"{_more(command)}; {shown}")
    return 0


def _simulated(command: options.Arena) -> Callable[[Dataset], None]:
    cfg = erring_rater(command.erring)

    def answer(dataset: Dataset) -> None:
        criterion = load_criterion(command.criterion or "", context_of_dataset(dataset))
        rater = f"simulated:{command.criterion}"
        answer_pairs(dataset, criterion, rater_id=rater, seed=command.seed, cfg=cfg)

    return answer


def _asked(command: options.Arena, standing: Standing) -> str:
    return (
        f"{standing.open_questions} questions are open: `gaitpref label --dataset "
        f"{command.out}/dataset --no-auth` asks them, and the same command counts the "
        f"answers and asks on"
    )


def _more(command: options.Arena) -> str:
    """What makes an order sure that is not, once all questions are answered."""
    return (
        f"all {command.most} questions are answered and the order is not sure: the "
        f"same command with `--most {2 * command.most}` asks on, and where its clips "
        f"are used up, with `--episodes {2 * command.episodes}` and another --out too"
    )
