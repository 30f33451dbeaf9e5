"""Clips by what a person types."""

from __future__ import annotations

from data.datasets.dataset import Dataset
from data.episodes.clips import Clip
from data.errors import GaitprefError


def find_clip(dataset: Dataset, name: str) -> Clip:
    """The clip called EPISODE:START+STEPS, or a whole episode by its hash's beginning.

    Raises:
        GaitprefError: there is no such clip, or more than one episode.
    """
    sha256, colon, place = name.partition(":")
    entries = [e for e in dataset.entries() if e.sha256.startswith(sha256)]
    if len(entries) != 1:
        raise GaitprefError(
            f"{dataset.root} holds {len(entries)} episodes whose hash begins with "
            f"{sha256!r}; `--clip` takes EPISODE:START+STEPS, or an episode"
        )
    entry = entries[0]
    if not colon:
        return Clip(entry.sha256, 0, entry.num_steps)
    try:
        start, steps = (int(number) for number in place.split("+"))
        clip = Clip(entry.sha256, start, steps)
    except ValueError:
        raise GaitprefError(f"--clip {name!r} is not EPISODE:START+STEPS") from None
    dataset.clip_features(clip)
    return clip
