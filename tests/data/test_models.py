"""A robot's model is stored once in a data set, and goes wherever its episodes go."""

import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from data.datasets.archive import pack, unpack
from data.datasets.dataset import Dataset
from data.datasets.manifest import encode_manifest
from data.datasets.recovery import recover, recover_file
from data.datasets.transfer import transfer
from data.datasets.verify import verify
from data.episodes.clips import Clip
from data.episodes.episode import decode_episode, read_episode
from data.episodes.model_store import INSIDE_BYTES
from data.episodes.writer import encode_episode
from data.errors import CorruptEpisode, DatasetError
from data.files.files import sha256_bytes
from data.remote.place import Place
from data.remote.sharing import pull, push
from tests.data.test_dataset import META
from tests.data.test_episode import assert_same, make_episode
from tests.helpers.required import needed

LARGE = f"<mujoco><!-- {'1.25 ' * 200_000} --></mujoco>"
OTHER = LARGE.replace("1.25", "2.25")
EPISODES = [make_episode(300, seed, meta=META, mjcf=LARGE) for seed in range(4)]


BY_STATES = {episode.qpos.tobytes(): episode for episode in EPISODES}


def only_model(dataset: Dataset) -> Path:
    (model,) = (dataset.root / "models").iterdir()
    return model


@pytest.fixture
def dataset(tmp_path: Path) -> Dataset:
    dataset = Dataset.create(tmp_path / "set")
    dataset.add_episodes(EPISODES)
    return dataset


def require_episodes(dataset: Dataset) -> None:
    """Everything is there and whole, also for who opens it anew."""
    assert not verify(dataset.root).damages
    fresh = Dataset.open(dataset.root)
    assert len(fresh.entries()) == len(EPISODES)
    for entry in fresh.entries():
        read = fresh.read(entry.sha256)
        assert_same(read, BY_STATES[read.qpos.tobytes()])
        assert fresh.clip_features(Clip(entry.sha256, 10, 20)).shape == (20, 90)


def test_a_large_model_is_stored_once(dataset: Dataset) -> None:
    """Under its hash; episodes are what they weigh alone, and read by themselves."""
    model = only_model(dataset)
    assert model.read_text() == LARGE
    assert model.stem == sha256_bytes(LARGE.encode())
    assert all(entry.bytes < 500_000 < len(LARGE) for entry in dataset.entries())
    require_episodes(dataset)
    entry = dataset.entries()[0]
    assert read_episode(dataset.root / entry.path).mjcf == LARGE
    with pytest.raises(CorruptEpisode, match="without the model"):
        decode_episode(dataset.content(entry), "x")


def test_small_models_and_old_episodes_are_as_they_were(tmp_path: Path) -> None:
    """A small model is in the file; a file that has a large one stays as it is."""
    small = make_episode(3, meta=META, mjcf="x" * INSIDE_BYTES)
    dataset = Dataset.create(tmp_path / "set")
    (entry,) = dataset.add_episodes([small])
    assert dataset.content(entry) == encode_episode(small)
    assert not (dataset.root / "models").exists()
    assert b"mjcf_sha256" not in encode_manifest(dataset.entries())

    content = encode_episode(EPISODES[0])
    sha256 = sha256_bytes(content)
    path = dataset.root / "rollouts" / sha256[:2] / f"{sha256}.mcap"
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(content)
    (old,) = dataset.adopt([path])
    assert (old.sha256, old.mjcf_sha256) == (sha256, "")
    assert_same(dataset.read(sha256), EPISODES[0])
    copy = Dataset.create(tmp_path / "copy")
    transfer(dataset, copy)
    assert copy.content(copy.entry(sha256)) == content
    assert not (copy.root / "models").exists()
    # Its end is damaged, its steps are not: it is made again under the same name.
    path.write_bytes(content[:-20] + b"?" * 20)
    (saved,) = recover(dataset.root)
    assert saved.episodes == (sha256,)
    assert path.read_bytes() == content


def through_archive(dataset: Dataset, folder: Path) -> Dataset:
    pack(dataset, folder / "set.zip")
    return unpack(folder / "set.zip", folder / "out")


def through_transfer(dataset: Dataset, folder: Path) -> Dataset:
    copy = Dataset.create(folder / "out")
    transfer(dataset, copy)
    return copy


def through_a_place(dataset: Dataset, folder: Path) -> Dataset:
    needed("fsspec", "FSSPEC")
    place = Place(str(folder / "place"))
    push(dataset, place)
    assert push(dataset, place).files == 0
    pull(place, folder / "out")
    return Dataset.open(folder / "out")


@pytest.mark.parametrize("way", [through_archive, through_transfer, through_a_place])
def test_the_model_goes_along(
    dataset: Dataset, tmp_path: Path, way: Callable[[Dataset, Path], Dataset]
) -> None:
    """By every way out, once, and the first data set is not needed any more."""
    copy = way(dataset, tmp_path)
    assert copy.entries() == dataset.entries()
    shutil.rmtree(dataset.root)
    require_episodes(copy)
    only_model(copy)
    sent = [path for path in tmp_path.rglob("*") if path.is_file()]
    once = sum(entry.bytes for entry in copy.entries()) + len(LARGE)
    assert sum(path.stat().st_size for path in sent) < 2.1 * once


@pytest.mark.parametrize("damage", ["missing", "changed"])
def test_a_damaged_model_is_found_and_mended(dataset: Dataset, damage: str) -> None:
    """Also where it has the right length; recording the robot again brings it back."""
    model = only_model(dataset)
    if damage == "missing":
        model.unlink()
    else:
        model.write_text(LARGE.replace("1.25", "9.25"))
    (found,) = verify(dataset.root).damages
    assert (found.kind, found.what) == (damage, f"models/{model.name}")
    fresh = Dataset.open(dataset.root)
    with pytest.raises(CorruptEpisode, match=r"copy of the data set"):
        fresh.read(fresh.entries()[0].sha256)
    recover(dataset.root)
    assert not model.exists()
    Dataset.open(dataset.root).add_episodes(EPISODES[:1])
    require_episodes(dataset)


def test_a_writer_that_was_killed_leaves_nothing_that_harms(dataset: Dataset) -> None:
    """Neither half a model nor one that no episode needs yet."""
    half = dataset.root / "models" / ".x.xml.0.tmp"
    half.write_text("<muj")
    dataset.models.add(OTHER)
    assert verify(dataset.root).left_over == ("models/.x.xml.0.tmp",)
    recover(dataset.root)
    assert not half.exists()
    require_episodes(dataset)


def test_what_is_left_of_a_cut_file_has_its_model(
    dataset: Dataset, tmp_path: Path
) -> None:
    """In its data set; elsewhere nobody has the model, and that is said."""
    entry = dataset.entries()[0]
    path = dataset.root / entry.path
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(dataset.content(entry)[:200_000])
    lost = recover_file(Dataset.create(tmp_path / "new"), cut)
    assert lost.problem == "its robot model is lost"
    path.write_bytes(cut.read_bytes())
    (saved,) = recover(dataset.root)
    assert dataset.read(saved.episodes[0]).mjcf == LARGE


def test_a_model_behind_a_link_is_refused(dataset: Dataset, tmp_path: Path) -> None:
    """It could be any file of the machine."""
    model = only_model(dataset)
    model.rename(tmp_path / "elsewhere.xml")
    model.symlink_to(tmp_path / "elsewhere.xml")
    fresh = Dataset.open(dataset.root)
    with pytest.raises(DatasetError, match="is a link"):
        fresh.read(fresh.entries()[0].sha256)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda names: names, "is not what its name says"),
        (lambda names: [n for n in names if "models" not in n], "is missing"),
        (lambda names: [*names, f"models/{'a' * 64}.xml"], "is not in the manifest"),
        (lambda names: [*names, "models/../x.xml"], "may not hold"),
    ],
)
def test_an_archive_brings_the_models_it_promises(
    dataset: Dataset,
    tmp_path: Path,
    change: Callable[[list[str]], list[str]],
    told: str,
) -> None:
    """No other, no fewer, and each is what its name says."""
    pack(dataset, tmp_path / "sound.zip")
    with (
        zipfile.ZipFile(tmp_path / "sound.zip") as sound,
        zipfile.ZipFile(tmp_path / "bad.zip", "w") as bad,
    ):
        for name in change(sound.namelist()):
            content = b"x" if name.startswith("models") else sound.read(name)
            bad.writestr(name, content)
    with pytest.raises(DatasetError, match=told):
        unpack(tmp_path / "bad.zip", tmp_path / "out")
    assert not (tmp_path / "out").exists()
