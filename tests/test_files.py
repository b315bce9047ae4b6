"""Files are whole or absent."""

from __future__ import annotations

import hashlib
import os
import stat
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sagnac.errors import InputError
from sagnac.files import sha256, write_atomically


def listed(folder: Path = Path()) -> list[str]:
    """Names in a folder."""
    return sorted(p.name for p in folder.iterdir())


def test_the_file_appears_only_when_the_block_ends_well(tmp_path):
    target = tmp_path / "a.txt"
    with write_atomically(target) as temporary:
        temporary.write_text("new")
        assert not target.exists()
        assert temporary.parent == target.parent  # the same disk, so that the move is one step
        assert temporary.suffix == ".txt"
    assert target.read_text() == "new"
    assert listed(tmp_path) == ["a.txt"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, InputError])
def test_an_error_leaves_the_old_file_and_nothing_else(tmp_path, error):
    target = tmp_path / "a.txt"
    target.write_text("old")

    def write() -> None:
        with write_atomically(target) as temporary:
            temporary.write_text("half of the n")
            raise error("stop")

    with pytest.raises(error, match="stop"):
        write()
    assert target.read_text() == "old"
    assert listed(tmp_path) == ["a.txt"]


def test_missing_folders_are_made(tmp_path):
    with write_atomically(tmp_path / "b" / "c" / "a.txt") as temporary:
        temporary.write_text("x")
    assert (tmp_path / "b" / "c" / "a.txt").read_text() == "x"


def test_a_folder_in_the_way_is_an_input_error(tmp_path):
    (tmp_path / "a.txt").mkdir()
    with pytest.raises(InputError, match=r"cannot write .*a\.txt"), write_atomically(tmp_path / "a.txt") as temporary:
        temporary.write_text("x")
    assert listed(tmp_path) == ["a.txt"]


def test_a_file_where_the_folder_should_be_is_an_input_error(tmp_path):
    (tmp_path / "b").write_text("I am a file")
    with pytest.raises(InputError, match="cannot write"), write_atomically(tmp_path / "b" / "a.txt"):
        pytest.fail("the block must not run")


def test_permissions_are_those_of_an_ordinary_file(tmp_path):
    old = os.umask(0o027)
    try:
        with write_atomically(tmp_path / "a.txt") as temporary:
            temporary.write_text("x")
    finally:
        os.umask(old)
    assert stat.S_IMODE((tmp_path / "a.txt").stat().st_mode) == 0o640  # 0o666 without what the mask takes


@given(st.binary(max_size=5000))
def test_sha256_is_that_of_the_bytes(tmp_path, data):
    (tmp_path / "x").write_bytes(data)
    assert sha256(tmp_path / "x") == hashlib.sha256(data).hexdigest()


def test_sha256_of_abc(tmp_path):
    (tmp_path / "x").write_bytes(b"abc")
    # FIPS 180-4, example of the one-block message
    assert sha256(tmp_path / "x") == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
