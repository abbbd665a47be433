"""Every command ends the same way: an exit code and at most one sentence."""

import errno

import pytest

from rasterize.command import run_command
from rasterize.errors import InputError


def failing(error: BaseException):
    def command() -> None:
        raise error

    return command


def test_success_is_silent(capsys):
    assert run_command("uvcloth", lambda: None) == 0
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("error", "code", "sentence"),
    [
        (InputError("walk.bvh: no\n  frames"), 2, "uvcloth: walk.bvh: no frames\n"),
        (KeyboardInterrupt(), 130, "uvcloth: interrupted; finished work is in place\n"),
        (
            OSError(errno.ENOSPC, "No space left on device", "out.glb"),
            2,
            "uvcloth: out.glb: cannot be written or read (No space left on device)\n",
        ),
        (
            OSError(errno.ENOSPC, "No space left on device"),
            2,
            "uvcloth: cannot be written or read (No space left on device)\n",
        ),
    ],
)
def test_one_sentence_and_the_code(capsys, error, code, sentence):
    assert run_command("uvcloth", failing(error)) == code
    assert capsys.readouterr() == ("", sentence)


@pytest.mark.parametrize("error", [ValueError("a bug"), OSError(errno.ECONNREFUSED, "a bug")])
def test_bugs_keep_their_traceback(error):
    with pytest.raises(type(error)):
        run_command("uvcloth", failing(error))
