"""The sequences of a data folder whose motion a rival gets."""

from pathlib import Path

from uvcloth.motion.index import INDEX, read_index


def sequences(data: Path, garment: str, split: str) -> list[Path]:
    """The files of a garment in a split of a data folder, on its usual body.

    Raises InputError as `read_index`.
    """
    entries = read_index(data / INDEX).values()
    paths = [data / f"{each.clip}_{garment}.npz" for each in entries if each.split == split]
    return [path for path in paths if path.is_file()]
