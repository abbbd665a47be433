"""Work in several processes."""

import os

import pytest

from uvcloth.errors import InputError
from uvcloth.process.pool import pool


def test_each_result_comes_back_and_a_lost_process_is_named() -> None:
    with pool(abs, 2, "made numbers") as made:
        assert sorted(made([-3, 1, -2])) == [1, 2, 3]
        assert not list(made([]))
    with (
        pytest.raises(InputError, match="a process that made numbers has ended; finished work is kept"),
        pool(os._exit, 1, "made numbers") as made,
    ):
        list(made([3]))


def test_each_job_has_a_new_process_where_asked() -> None:
    with pool(_process, 1, "counted", fresh=True) as counted:
        assert len(set(counted(range(2)))) == 2


def _process(job: int) -> int:
    return os.getpid()
