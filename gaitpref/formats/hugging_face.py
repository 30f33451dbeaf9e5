"""Export as Hugging Face Parquet: a row for every preference, `chosen` and `rejected`.

The format has no place for an equal answer, nor for how sure a rater was of the side;
`target` keeps the strength, and `gaitpref data labels` keeps everything.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from data.episodes.clips import Clip
from data.episodes.schema import feature_columns
from gaitpref.console.extras import require

from .export_source import Exported, Source, new_directory

_CARD = """---
configs:
- config_name: default
  data_files: data/*.parquet
license: unknown
---
Preferences between clips of quadruped gaits. `chosen` and `rejected` hold one row for
each control step with the columns listed below; `target` is the probability that the
chosen clip is the better one. Fill in the licence before you publish.

"""


def export_hugging_face(source: Source, out: Path) -> Exported:
    """Write Parquet and a card; `datasets.load_dataset(out)` opens it.

    Raises:
        GaitprefError: `out` is there, an episode cannot be used, or pyarrow is missing.
    """
    pa, pq = require("pyarrow", "export"), require("pyarrow.parquet", "export")
    used, without = source.preferences()
    preferred = [row for row in used if row[1].target != 0.5]
    known = {entry.sha256 for entry in source.dataset.entries()}
    here = [
        (pair, answer)
        for pair, answer in preferred
        if {pair.a.rollout, pair.b.rollout} <= known
    ]
    rows: dict[str, list[Any]] = {name: [] for name in _schema(pa).names}
    for done, (pair, answer) in enumerate(here):
        source.tell(done, len(here))
        target = answer.target or 0.0
        a_chosen = target > 0.5
        chosen, rejected = (pair.a, pair.b) if a_chosen else (pair.b, pair.a)
        values = {
            "chosen": source.dataset.clip_features(chosen).tolist(),
            "rejected": source.dataset.clip_features(rejected).tolist(),
            "target": target if a_chosen else 1.0 - target,
            "pair_id": pair.pair_id,
            "rater": answer.rater_id,
            "chosen_clip": chosen.key,
            "rejected_clip": rejected.key,
        }
        for name, value in values.items():
            rows[name].append(value)
    with new_directory(source, out) as partial:
        (partial / "data").mkdir()
        table = pa.table(rows, schema=_schema(pa))
        pq.write_table(table, partial / "data" / "train-00000.parquet")
        names = "".join(f"- `{name}`\n" for name in feature_columns())
        (partial / "README.md").write_text(_CARD + names)
    clips: set[Clip] = {clip for pair, _ in here for clip in (pair.a, pair.b)}
    return Exported(
        out=str(out),
        episodes=len({clip.rollout for clip in clips}),
        steps=sum(clip.steps for clip in clips),
        preferences=len(here),
        left_out_episodes=0,
        left_out_answers=without + len(used) - len(here),
    )


def _schema(pa: Any) -> Any:
    clip = pa.list_(pa.list_(pa.float32()))
    text = pa.string()
    return pa.schema(
        [
            ("chosen", clip),
            ("rejected", clip),
            ("target", pa.float32()),
            ("pair_id", text),
            ("rater", text),
            ("chosen_clip", text),
            ("rejected_clip", text),
        ]
    )
