"""Do people see what pairs differ by? Pictures of pairs, the key apart from them.

`python -m studies.seen_pairs --dataset DATASET --out FOLDER` draws pairs that differ by
so many times what is noticed, in any order: both clips as film strips over their
footfalls and how far they came, as on the page. Who looks says of each what differs,
before reading `key.json`; `--told 1 4 7` then counts the pictures of which that was
right, by difference.

Shapes: K pairs, H, W of a picture in pixels.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import tyro
from PIL import Image, ImageDraw

from data.answers.answer_records import Pair
from data.datasets.dataset import Dataset
from data.episodes.clips import Clip
from data.episodes.visible_habits import VISIBLE_HABITS, most_different
from gaitpref.programs.seen_pair import SeenClip, seen_pair
from gaitpref.programs.strips import png_of
from labeling_ui.page.footfall_svg import went_words
from labeling_ui.scene.clip_motion import Motion, MotionCache
from rewardmodel.asking.clip_questions import ClipCfg, ask
from rewardmodel.asking.visible import Visible

KEY_NAME = "key.json"
_NEAR = 0.12
"""A pair counts as one of a difference that it has within so much of it."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Pairs of a data set as pictures, and how many were told apart."""

    dataset: Path
    out: Path
    """Gets the pictures and the key."""
    at: tuple[float, ...] = (0.3, 0.5, 0.8, 1.0, 1.5)
    """Differences, in those that are just noticed."""
    each: int = 5
    """Pairs of each."""
    seed: int = 0
    told: tuple[int, ...] | None = None
    """Numbers of pictures whose clips were told apart; nothing is drawn then."""


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """What a picture shows."""

    at: float
    """The difference that was looked for."""
    differs: float
    """The one it has, in the habit in which it differs most."""
    most: str
    """That habit, in words."""
    leads: dict[str, float]
    """Of each habit how much more of it A has, in differences that are noticed."""


@dataclass(frozen=True)
class _Near:
    """Tells which pairs differ by about so much, and by no more."""

    visible: Visible
    at: float

    def __call__(self, clips: Sequence[Clip], pairs: np.ndarray) -> np.ndarray:
        apart = most_different(self.visible.habits(clips), pairs)
        return np.abs(apart / self.at - 1) <= _NEAR


def pairs_at(
    visible: Visible, at: float, count: int, rng: np.random.Generator
) -> list[Pair]:
    """Up to `count` pairs that differ by about `at`, chosen as people's are."""
    dataset = visible.dataset
    near = _Near(visible, at)
    chosen = ask(
        dataset,
        dataset.entries(),
        ClipCfg(),
        count,
        known=[],
        model=None,
        round_number=0,
        uniform_share=1.0,
        told_apart=near,
        rng=rng,
    )
    return [pair for pair in chosen if near([pair.a, pair.b], np.array([[0, 1]]))[0]]


def drawn(visible: Visible, pair: Pair, at: float) -> Drawn:
    """The difference of a pair, and its words."""
    left, right = visible.habits([pair.a, pair.b])
    lead = np.nan_to_num(left - right)
    index = int(np.abs(lead).argmax())
    habit, more = VISIBLE_HABITS[index], "AB"[int(lead[index] < 0)]
    amount = habit.amount(abs(lead[index]) * habit.noticed)
    return Drawn(
        at=at,
        differs=round(float(abs(lead[index])), 2),
        most=f"{more} {habit.says.format(amount)}",
        leads={
            each.name: round(float(of_it), 2)
            for each, of_it in zip(VISIBLE_HABITS, lead, strict=True)
        },
    )


def picture(dataset: Dataset, pair: Pair) -> np.ndarray:
    """[H, W, 3] uint8: A to the left, B to the right."""
    seen, motions = seen_pair(dataset, pair, "a"), MotionCache(dataset)
    sides = (seen.left, pair.a), (seen.right, pair.b)
    columns = [_column(side, motions.get(clip)) for side, clip in sides]
    return np.concatenate(columns, axis=1)


def _column(clip: SeenClip, motion: Motion) -> np.ndarray:
    strip, feet = Image.fromarray(clip.film_strip), Image.fromarray(clip.footfalls)
    column = Image.new("RGB", (strip.width, strip.height + feet.height), "white")
    column.paste(strip, (0, 0))
    column.paste(feet, (0, strip.height))
    went = went_words(motion.obeyed).replace("<br>", "\n")
    ImageDraw.Draw(column).text((feet.width + 8, strip.height + 20), went, "black")
    return np.asarray(column)


def draw(options: Options) -> int:
    """Write the pictures and the key; gives how many."""
    rng = np.random.default_rng(options.seed)
    dataset = Dataset.open(options.dataset)
    visible = Visible(dataset)
    found = [
        (pair, drawn(visible, pair, at))
        for at in options.at
        for pair in pairs_at(visible, at, options.each, rng)
    ]
    options.out.mkdir(parents=True, exist_ok=True)
    key = {}
    for number, index in enumerate(rng.permutation(len(found)), start=1):
        pair, told = found[index]
        (options.out / f"{number:02d}.png").write_bytes(png_of(picture(dataset, pair)))
        key[f"{number}"] = asdict(told)
    (options.out / KEY_NAME).write_text(json.dumps(key, indent=1))
    return len(found)


def table(key: dict[str, dict], told: Sequence[int]) -> list[str]:
    """A line for each difference: how many of its pairs were told apart."""
    lines = []
    for at in sorted({entry["at"] for entry in key.values()}):
        own = [int(number) for number, entry in key.items() if entry["at"] == at]
        seen = sum(number in told for number in own)
        lines.append(f"| {at:g} | {seen} of {len(own)} |")
    return lines


def main(options: Options) -> int:
    if options.told is None:
        print(f"{draw(options)} pictures are in {options.out}")
        return 0
    key = json.loads((options.out / KEY_NAME).read_text())
    print("\n".join(table(key, options.told)))
    return 0


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Options, config=(tyro.conf.OmitArgPrefixes,))))
