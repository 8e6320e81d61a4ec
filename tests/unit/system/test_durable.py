from __future__ import annotations

import errno
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from hqpipe.system import durable

sys.path.append(str(Path(__file__).parents[2]))
from file_operations import each_kill


def folder_of(path: Path, text: str) -> Path:
    path.mkdir(parents=True)
    (path / "a.txt").write_text(text)
    return path


def test_a_file_is_replaced_in_one_step(tmp_path):
    path = tmp_path / "result.json"

    def prepare() -> None:
        for left in tmp_path.iterdir():
            left.unlink()
        path.write_text("old")

    seen = []
    for _ in each_kill(lambda: durable.write_file(path, "new"), prepare):
        seen.append(path.read_text())
        durable.remove_leftovers(tmp_path)
        assert [left.name for left in tmp_path.iterdir()] == ["result.json"]
    assert set(seen) == {"old", "new"}


def test_a_file_that_cannot_be_written_leaves_the_old_one(tmp_path, monkeypatch):
    def fail(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    (tmp_path / "a").write_text("old")
    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(OSError, match="No space"):
        durable.write_file(tmp_path / "a", "new")
    assert (tmp_path / "a").read_text() == "old" and len(list(tmp_path.iterdir())) == 1


def test_everything_is_flushed_before_it_has_its_name(tmp_path, monkeypatch):
    done = []
    original, rename = os.fsync, os.rename

    def fsync(descriptor: int) -> None:
        done.append(os.readlink(f"/proc/self/fd/{descriptor}").removeprefix(f"{tmp_path}"))
        original(descriptor)

    def renamed(old: Path, new: Path) -> None:
        done.append("rename")
        rename(old, new)

    monkeypatch.setattr(os, "fsync", fsync)
    monkeypatch.setattr(os, "rename", renamed)
    new = durable.new_folder(tmp_path / "result")
    folder_of(new / "part", "text")
    durable.move_into_place(new, tmp_path / "result")
    names = [name.replace(new.name, "new") for name in done]
    assert names == ["/new/part/a.txt", "/new/part", "/new", "rename", ""]


@pytest.mark.parametrize("exchange", [True, False])
@pytest.mark.parametrize("kind", ["nothing", "folder", "file", "link", "dangling link"])
def test_whatever_has_the_name_is_replaced(tmp_path, monkeypatch, kind, exchange):
    if not exchange:
        monkeypatch.setattr(durable, "_exchange", lambda first, second: False)
    target, other = tmp_path / "result", folder_of(tmp_path / "other", "precious")
    if kind == "folder":
        folder_of(target, "old")
    elif kind == "file":
        target.write_text("old")
    elif kind != "nothing":
        target.symlink_to(other if kind == "link" else "nowhere")
    durable.move_into_place(folder_of(tmp_path / ".tmp-x", "new"), target)
    assert (target / "a.txt").read_text() == "new" and not target.is_symlink()
    assert (other / "a.txt").read_text() == "precious"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["other", "result"]


def test_exchange_is_used_here(tmp_path):
    assert durable._exchange(folder_of(tmp_path / "a", "a"), folder_of(tmp_path / "b", "b"))
    assert (tmp_path / "a" / "a.txt").read_text() == "b"
    with pytest.raises(FileNotFoundError):
        durable._exchange(tmp_path / "a", tmp_path / "absent")


def test_what_was_being_replaced_is_put_back(tmp_path):
    folder_of(tmp_path / f"{durable.REPLACED}result", "old")
    folder_of(tmp_path / ".tmp-result-1", "half")
    durable.remove_leftovers(tmp_path)
    assert (tmp_path / "result" / "a.txt").read_text() == "old" and len(list(tmp_path.iterdir())) == 1


def test_remove_follows_no_link_and_needs_no_permission(tmp_path):
    precious = folder_of(tmp_path / "precious", "precious")
    folder = folder_of(tmp_path / "folder", "a")
    (folder / "link").symlink_to(precious)
    (folder / "a.txt").chmod(0o400)
    folder.chmod(0o500)
    durable.remove(folder)
    durable.remove(tmp_path / "absent")
    assert not folder.exists() and (precious / "a.txt").exists()


def test_remove_without_being_the_superuser(tmp_path):
    """The superuser may remove anything, so this is done by somebody else where the tests run as root."""
    folder = folder_of(tmp_path / "folder" / "part", "a").parent
    for path in (folder / "part", folder):
        path.chmod(0o500)
    child = os.fork()
    if child == 0:
        code = 1
        try:
            os.chdir(tmp_path)  # the folders above are closed to others
            if os.getuid() == 0:
                for path in (tmp_path, folder, folder / "part", folder / "part" / "a.txt"):
                    os.chown(path, 65534, 65534)
                os.setuid(65534)
            durable.remove(Path("folder"))
            code = len(os.listdir())
        finally:
            os._exit(code)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


def test_a_full_disk_that_cannot_rename_can_still_remove(tmp_path, monkeypatch):
    def fail(old: Path, new: Path) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "rename", fail)
    durable.remove(folder_of(tmp_path / "folder", "a"))
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(shutil.which("sha256sum") is None, reason="sha256sum is not installed")
def test_checksums_are_those_of_sha256sum(tmp_path):
    folder_of(tmp_path / "part", "a")
    durable.write_checksums(tmp_path)
    result = subprocess.run(["sha256sum", "--check", durable.CHECKSUMS], cwd=tmp_path, capture_output=True, text=True)
    assert result.returncode == 0 and result.stdout == "part/a.txt: OK\n"


@pytest.mark.parametrize("change", ["added", "removed", "renamed", "changed", "no sums", "pipe"])
def test_every_change_is_damage(tmp_path, change):
    folder = folder_of(tmp_path / "folder", "a")
    durable.write_checksums(folder)
    assert durable.damage(folder) is None
    path = folder / "a.txt"
    if change == "added":
        (folder / "b.txt").touch()
    elif change == "renamed":
        path.rename(folder / "b.txt")
    elif change == "changed":
        path.write_text("b")
    elif change == "removed":
        path.unlink()
    else:
        (folder / durable.CHECKSUMS).unlink()
        if change == "pipe":
            os.mkfifo(folder / durable.CHECKSUMS)
    assert durable.damage(folder)
    assert durable.damage(tmp_path / "absent")
