"""What `gaitpref data` does; needs no torch and no simulator."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

from data.datasets.archive import CARD_NAME, pack, unpack
from data.datasets.card import CardFacts, card
from data.datasets.dataset import Dataset
from data.datasets.labels import labels, to_csv, to_jsonl
from data.datasets.manifest_file import writable
from data.datasets.overview import overview
from data.datasets.recovery import RecoveredFile, recover, recover_file
from data.datasets.transfer import Transferred, split, transfer
from data.datasets.verify import Verified, verify
from data.episodes.clips import Clip
from data.errors import DatasetError
from data.files.files import write_atomically
from data.files.shown import shown
from data.files.telling import Tell
from data.remote.place import Place
from data.remote.sharing import pull, push
from gaitpref.cli.options import data_options as options
from gaitpref.cli.shared.dataset_argument import address, open_dataset
from gaitpref.cli.shared.next_of_data import next_of_data
from gaitpref.console.extras import require
from gaitpref.console.progress import counted
from gaitpref.console.terminal import PlainConsole, say

from .data_info import info
from .exchange import export, import_into

EXIT_DAMAGED = 1
console = PlainConsole(stderr=True)


def run(action: options.Action) -> int:
    """Run one `gaitpref data` command; gives the exit code."""
    code = _done(action)
    text = next_of_data(action, damaged=code == EXIT_DAMAGED)
    if text and not getattr(action, "json", False):
        console.next(text)
    return code


def _done(action: options.Action) -> int:
    match action:
        case options.Info():
            info(action)
        case options.Verify():
            return _verify(action)
        case options.Recover():
            return _recover(action)
        case options.Merge() | options.Split() | options.Subset():
            _transfer(action)
        case options.Pack():
            with counted("packing, episodes") as tell:
                size = pack(open_dataset(action), action.out, tell=tell)
            _say(action.json, {"archive": str(action.out), "bytes": size})
        case options.Unpack():
            with counted("unpacking, episodes") as tell:
                made = unpack(action.archive, action.dataset, tell=tell)
            holds = {"dataset": str(made.root), "episodes": len(made.entries())}
            _say(action.json, holds)
        case options.Card():
            _card(action)
        case options.Labels():
            _labels(action)
        case options.View():
            _view(action)
        case options.Import():
            _imported(action, import_into(action))
        case options.Export():
            held = "preferences" if action.format == "hf" else "episodes"
            with counted(f"writing as {action.format}, {held}") as tell:
                written = asdict(export(action, tell))
            _say(action.json, written)
        case options.Push() | options.Pull():
            _share(action)
    return 0


def _verify(action: options.Verify) -> int:
    with counted("comparing every byte, episodes") as tell:
        found = verify(action.dataset, answers=address(action.answers), tell=tell)
    if action.json:
        print(json.dumps(asdict(found)))
    else:
        _print_verified(found)
    return EXIT_DAMAGED if found.damages else 0


def _print_verified(found: Verified) -> None:
    for damage in found.damages:
        touched = ""
        if damage.episode:
            touched += f"; episode {damage.episode}"
        if damage.answers:
            touched += f"; answers {', '.join(damage.answers)}"
        say(f"{damage.kind}: {damage.what}: {damage.message}{touched}")
    for name in found.left_over:
        say(f"left over: {name}: no manifest knows it, `gaitpref data recover` does")
    print(
        f"{found.episodes:,} episodes, {found.bytes:,} bytes and {found.answers:,} "
        f"answers looked at, {len(found.damages)} damaged"
    )


def _recover(action: options.Recover) -> int:
    if action.file:
        dataset = Dataset.create(action.dataset)
        files: list[RecoveredFile] = []
        for path in action.file:
            if not path.is_file():
                raise DatasetError(f"{path} is no file; give a cut or damaged episode")
            files.append(recover_file(dataset, path))
    else:
        with counted("looking for what is whole, files") as tell:
            files = recover(action.dataset, tell=tell)
    kept = sum(file.kept_steps for file in files)
    lost = sum(file.lost_steps or 0 for file in files)
    if action.json:
        report = {"files": [asdict(f) for f in files], "kept": kept, "lost": lost}
        print(json.dumps(report))
    else:
        for file in files:
            gone = "an unknown number" if file.lost_steps is None else file.lost_steps
            why = f" ({file.problem})" if file.problem else ""
            say(f"{file.file}: kept {file.kept_steps} steps, lost {gone}{why}")
        print(f"{len(files)} files, kept {kept:,} steps, lost {lost:,}")
    return EXIT_DAMAGED if any(file.problem for file in files) else 0


def _transfer(action: options.Merge | options.Split | options.Subset) -> None:
    with counted("copying, episodes") as tell:
        report = _transferred(action, tell)
    if action.json:
        print(json.dumps({name: asdict(part) for name, part in report.items()}))
        return
    for name, part in report.items():
        renamed = "".join(f"; {old} is now {new}" for old, new in part.renamed.items())
        say(
            f"{name}: {part.episodes:,} episodes, {part.pairs:,} pairs and "
            f"{part.answers:,} answers were new, {part.left_out:,} answers stayed "
            f"behind{renamed}"
        )


def _transferred(
    action: options.Merge | options.Split | options.Subset, tell: Tell
) -> dict[str, Transferred]:
    match action:
        case options.Merge():
            sources = {str(path): Dataset.open(path) for path in action.source}
            answers = address(action.answers)
            target = Dataset.create(action.dataset, answers=answers)
            return {
                name: transfer(source, target, tell=tell)
                for name, source in sources.items()
            }
        case options.Split():
            source, shares = open_dataset(action), _shares(action.part)
            return split(source, shares, action.out, seed=action.seed, tell=tell)
        case options.Subset():
            return {str(action.out): _subset(action, tell)}


def _share(action: options.Push | options.Pull) -> None:
    place, answers = Place(action.url), address(action.answers)
    sends = isinstance(action, options.Push)
    with counted("sending" if sends else "taking") as tell:
        if sends:
            dataset = Dataset.open(action.dataset, answers=answers)
            found = push(dataset, place, tell=tell)
        else:
            found = pull(place, action.dataset, answers=answers, tell=tell)
    if action.json:
        print(json.dumps(asdict(found)))
        return
    renamed = "".join(f"; {old} is now {new}" for old, new in found.renamed.items())
    say(
        f"{action.dataset} {'to' if sends else 'from'} {place.name}: "
        f"{found.files:,} files of {found.bytes:,} bytes went, "
        f"{found.episodes:,} episodes, {found.pairs:,} pairs and {found.answers:,} "
        f"answers were new, {found.left_out:,} answers stayed behind{renamed}"
    )


def _shares(parts: tuple[str, ...]) -> dict[str, float]:
    shares: dict[str, float] = {}
    for part in parts:
        name, _, share = part.partition("=")
        try:
            shares[name] = float(share)
        except ValueError:
            raise DatasetError(f"--part takes NAME=SHARE, got {part!r}") from None
        if not name or Path(name).name != name or name.startswith("."):
            raise DatasetError(f"--part {part!r}: the name must be a plain word")
    return shares


def _subset(action: options.Subset, tell: Tell) -> Transferred:
    source = open_dataset(action)
    entries = [
        entry
        for entry in source.entries()
        if entry.meta.policy_sha256.startswith(action.policy or "")
        and action.round in (None, entry.meta.round)
        and action.robot in (None, entry.meta.robot)
        and action.end in (None, entry.end_reason)
    ]
    hashes = {entry.sha256 for entry in entries}
    if action.rater is not None:
        with source.answers_copy() as store:
            rows = store.all_answers()
        pairs = [pair for pair, answer in rows if answer.rater_id == action.rater]
        hashes &= {clip.rollout for pair in pairs for clip in (pair.a, pair.b)}
    if not hashes:
        raise DatasetError(
            f"no episode of {source.root} fits these filters; `gaitpref data info "
            f"--dataset {source.root}` lists what there is"
        )
    return transfer(
        source,
        Dataset.create(action.out),
        episodes=hashes,
        wanted=lambda pair, answer: action.rater in (None, answer.rater_id),
        keep_open_pairs=action.rater is None,
        tell=tell,
    )


def _card(action: options.Card) -> None:
    facts = CardFacts(
        title=action.title,
        author=action.author,
        licence_rollouts=action.licence_rollouts,
        licence_answers=action.licence_answers,
        licence_robot=action.licence_robot,
        consent=action.consent,
    )
    path = action.out or action.dataset / CARD_NAME
    text = card(overview(open_dataset(action)), facts)
    _write(path, text.encode())
    if facts.open_fields:
        names = ", ".join(name.replace("_", " ") for name in facts.open_fields)
        console.print(f"fill in before you publish: {names}")


def _labels(action: options.Labels) -> None:
    rows = labels(open_dataset(action))
    if action.format == "parquet":
        if action.out is None:
            raise DatasetError("parquet is no text; give --out FILE.parquet")
        from gaitpref.formats.parquet_labels import write_labels

        with writable(action.out.parent):
            write_labels(action.out, rows)
        console.print(f"{len(rows):,} answers are in {action.out}")
        return
    text = to_csv(rows) if action.format == "csv" else to_jsonl(rows)
    if action.out is None:
        sys.stdout.write(text)
    else:
        with _folder(action.out):
            write_atomically(action.out, text.encode())
        console.print(f"{len(rows):,} answers are in {action.out}")


def _view(action: options.View) -> None:
    dataset = open_dataset(action)
    if (action.pair is None) == (action.episode is None):
        raise DatasetError("say what to show: either --pair ID or --episode ID")
    if action.pair is not None:
        with dataset.answers_copy() as store:
            pairs = {pair.pair_id: pair for pair in store.pairs()}
        pair = pairs[_only(pairs, action.pair, "pair", action.dataset)]
        clips = {"a": pair.a, "b": pair.b}
    else:
        entries = {entry.sha256: entry for entry in dataset.entries()}
        sha256 = _only(entries, action.episode or "", "episode", action.dataset)
        clips = {"robot": Clip(sha256, 0, entries[sha256].num_steps)}
    # Before the import, which would name a package and not the extra.
    for module in ("mcap_ros2.writer", "mujoco"):
        require(module, "view")
    from gaitpref.formats.viewers.view_export import layout_path, write_view

    with writable(action.out.parent):
        write_view(action.out, dataset, clips)
    console.print(f"{action.out} and {layout_path(action.out)} are written")


def _only(known: Iterable[str], start: str, what: str, where: Path) -> str:
    """The one id that begins with `start`."""
    found = [name for name in known if name.startswith(start)]
    if len(found) != 1:
        raise DatasetError(
            f"{len(found)} {what}s of {where} begin with {start!r}; give more of the id"
        )
    return found[0]


def _write(path: Path, content: bytes) -> None:
    with _folder(path):
        write_atomically(path, content)
    console.print(f"{path} is written")


@contextmanager
def _folder(path: Path) -> Iterator[None]:
    """The folder of a file that is to be written.

    Raises:
        DatasetError: it is none, or nobody may write there.
    """
    with writable(path.parent):
        if not path.parent.is_dir():
            raise DatasetError(f"{path.parent} is no directory; make it first")
        yield


def _imported(action: options.Import, facts: dict[str, Any]) -> None:
    """Print what was taken in, then each kind that was left out, then what is odd."""
    if action.json or "left_out" not in facts:
        _say(action.json, facts)
        return
    left_out, told = facts.pop("left_out"), facts.pop("told")
    for key in ("missing", "estimated"):
        facts[key] = ", ".join(facts[key]) or "nothing"
    for key in ("asked_m_s", "seen_m_s"):
        facts[key] = "not known" if facts[key] is None else facts[key]
    _say(False, facts)
    for kind, count in left_out.items():
        say(shown(f"left out: {kind}: {count:,}"))
    for line in told:
        say(shown(f"note: {line}"))


def _say(as_json: bool, facts: dict[str, Any]) -> None:
    if as_json:
        print(json.dumps(facts))
    else:
        say(", ".join(f"{name} {value}" for name, value in facts.items()))
