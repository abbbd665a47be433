"""Every command ends the same way: an exit code and at most one sentence."""

import errno
import os
import subprocess
import sys

import pytest

from uvcloth.errors import InputError
from uvcloth.process.command import run_command


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
            OSError(errno.ENOSPC, "No space left on device", "a b/.out.glb.partial/finished/out.glb"),
            2,
            "uvcloth: a b/out.glb: cannot be written or read (No space left on device)\n",
        ),
        (InputError("x" * 10_000), 2, f"uvcloth: {'x' * 300} ... {'x' * 300}\n"),
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


@pytest.mark.parametrize("encoding", ["ascii", "cp1252", "utf-8"])
def test_names_of_any_script_are_printed_on_any_terminal(encoding):
    code = (
        "import sys; from uvcloth.process.command import run_command; from uvcloth.errors import InputError\n"
        r"def main(): print('\u0141\u00f3d\u017a \udc80.obj'); raise InputError('\u670d.obj: no such file')"
        "\nsys.exit(run_command('uvcloth', main))"
    )
    plain = os.environ | {"PYTHONIOENCODING": encoding, "PYTHONUTF8": "0", "LC_ALL": "C"}
    ended = subprocess.run([sys.executable, "-c", code], env=plain, capture_output=True, check=False)
    assert ended.returncode == 2
    assert (b"Traceback" in ended.stderr, ended.stderr.strip().endswith(b": no such file")) == (False, True)
    assert ended.stdout.strip().endswith(rb"\udc80.obj")


@pytest.mark.parametrize("ending", ["pass", "raise SystemExit(0)"])
def test_output_that_nobody_reads_is_no_traceback(ending):
    code = (
        "import sys; from uvcloth.process.command import run_command\n"
        f"def main():\n    print('frame\\n' * 100_000)\n    {ending}\n"
        "sys.exit(run_command('uvcloth', main))"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout
        assert process.stderr
        process.stdout.readline()
        process.stdout.close()
        assert (process.wait(), process.stderr.read()) == (141, b"")
