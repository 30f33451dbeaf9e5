"""`gaitpref film`: a clip, a pair or policies as MP4, GIF or WebP."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from contextlib import ExitStack, closing

import numpy as np

from data.answers.curation import find_pair
from data.datasets.dataset import Dataset
from data.datasets.named_clip import find_clip
from data.errors import GaitprefError
from data.files.telling import one_of
from gaitpref.cli.options import options
from gaitpref.console.progress import console, counted, counting_bar, working
from gaitpref.console.terminal import say
from gaitpref.film.camera import CameraCfg
from gaitpref.film.reel import FilmCfg, film, frame_count, require_kind, write_film
from gaitpref.film.shot import Shot
from gaitpref.film.sources import shot_of_clip, shot_of_policy, shots_of_pair
from policy.robots.shipped import WALK


def run(command: options.Film) -> int:
    """Run the command; gives the exit code."""
    require_kind(command.out)
    cfg = _cfg(command)
    shots = _shots(command)
    count = frame_count(shots, cfg)
    with ExitStack() as told, closing(_drawn(shots, cfg, count, told)) as frames:
        write_film(frames, command.out, cfg.fps)
    size_kb = command.out.stat().st_size / 1e3
    say(f"{command.out}, {count / cfg.fps:.1f} s, {size_kb:,.0f} kB")
    console.next(_next(command))
    return 0


def _drawn(
    shots: Sequence[Shot], cfg: FilmCfg, count: int, told: ExitStack
) -> Generator[np.ndarray]:
    """The frames, counted; behind the last one they are encoded, which nobody can
    count."""
    with counting_bar("frames", count) as bar:
        yield from film(shots, cfg, lambda: bar.advance(bar.task_ids[0]))
    told.enter_context(working(f"encoding {count} frames"))


def _next(command: options.Film) -> str:
    if command.dataset is None:
        policy = f" --policy {command.policy}" * bool(command.policy)
        against = f" --against {command.against}" * bool(command.against)
        return f"`gaitpref play{policy}{against} --open` lets you drive it"
    episode = f"--episode {(command.clip or '').partition(':')[0]}"
    shown = f"--pair {command.pair}" if command.pair else episode
    return (
        f"`gaitpref data view --dataset {command.dataset} {shown} --out view.mcap` "
        "shows every number of it beside the robot"
    )


def _cfg(command: options.Film) -> FilmCfg:
    """How the film is made.

    Raises:
        GaitprefError: a value is out of range.
    """
    try:
        camera = CameraCfg(width_px=command.width_px, height_px=command.height_px)
        return FilmCfg(camera=camera, fps=command.fps, speed=command.speed)
    except ValueError as error:
        raise GaitprefError(str(error)) from None


def _shots(command: options.Film) -> list[Shot]:
    """What is asked for.

    Raises:
        GaitprefError: it is not one thing.
    """
    if command.dataset is None:
        if command.clip or command.pair:
            raise GaitprefError("--clip and --pair are of a --dataset; none is given")
        paths = [command.policy or WALK]
        paths += [command.against] if command.against else []
        with counted("recording, steps") as tell:
            return [
                shot_of_policy(
                    path,
                    command.command,
                    duration_s=command.duration_s,
                    seed=command.seed,
                    tell=one_of(len(paths), number, tell),
                )
                for number, path in enumerate(paths)
            ]
    if command.policy or command.against or bool(command.clip) == bool(command.pair):
        raise GaitprefError(
            "of a --dataset either --clip or --pair is filmed, and no --policy"
        )
    dataset = Dataset.open(command.dataset)
    if command.pair:
        with dataset.answers_copy() as store:
            pair = find_pair(store, command.pair)
        return list(shots_of_pair(dataset, pair))
    assert command.clip
    return [shot_of_clip(dataset, find_clip(dataset, command.clip))]
