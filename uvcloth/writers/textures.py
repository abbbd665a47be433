"""Texture files beside the files that name them."""

from pathlib import Path

from uvcloth.files.atomic import atomic_write
from uvcloth.files.fields import safe_file_name
from uvcloth.geometry.authored import Texture


def save_texture(texture: Texture, path: Path) -> str:
    """Write a texture beside a file, named after both, and return its name.

    Raises InputError if it cannot be written.
    """
    name = f"{path.stem}_{safe_file_name(texture.name)}{texture.suffix}".replace(" ", "_")
    with atomic_write(path.with_name(name)) as partial:
        partial.write_bytes(texture.content)
    return name
