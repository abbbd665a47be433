"""A made-up character that commands dress."""

from pathlib import Path

import pytest

from tests.characters.made_up import t_posed, write_character
from tests.characters.test_characters import pieces
from uvcloth.bodies.body import Body
from uvcloth.characters.body import CharacterBody, body_from_character


@pytest.fixture(scope="session")
def character(body: Body, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A character in centimetres, Z up, with its arms raised and joints of other names."""
    path = tmp_path_factory.mktemp("character") / "hero.glb"
    write_character(path, t_posed(body), pieces(body)[:2])
    return path


@pytest.fixture(scope="session")
def fitted(character: Path, body: Body) -> CharacterBody:
    """The character as a body of ours, found once for all."""
    return body_from_character(character, body)
