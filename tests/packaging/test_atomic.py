"""Files and folders appear whole or not at all."""

import pytest

from jointscope.atomic import new_directory, replaced_file, write_text


def test_a_failed_write_leaves_the_old_file_and_no_litter(tmp_path):
    """What stood there stays, byte for byte."""
    path = tmp_path / "result.json"
    write_text(path, "old")

    def fail():
        with replaced_file(path) as temporary:
            temporary.write_text("half")
            raise RuntimeError("disk full")

    with pytest.raises(RuntimeError):
        fail()
    assert path.read_text() == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["result.json"]


def test_a_directory_is_renamed_into_place_only_when_complete(tmp_path):
    """No half-written folder under the final name."""
    target = tmp_path / "campaign"

    def fail():
        with new_directory(target) as temporary:
            (temporary / "a.csv").write_text("1")
            raise RuntimeError("interrupted")

    with pytest.raises(RuntimeError):
        fail()
    assert list(tmp_path.iterdir()) == []
    with new_directory(target) as temporary:
        (temporary / "a.csv").write_text("1")
    assert (target / "a.csv").read_text() == "1"


def test_a_folder_that_holds_something_is_never_overwritten(tmp_path):
    """The message names the folder and the way out."""
    (tmp_path / "old.txt").write_text("keep")
    with pytest.raises(FileExistsError, match="choose another --out"), new_directory(tmp_path):
        pass
