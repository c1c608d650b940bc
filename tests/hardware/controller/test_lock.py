"""Two executors for one robot: the second is refused, and told who the first is."""

import os
import pickle
import subprocess
import sys
from pathlib import Path

import pytest

from unwrinkle.hardware.controller.lock import OwnerLock, lock_directory
from unwrinkle.models.errors import HardwareError, InUseError

pytestmark = pytest.mark.alone


def test_the_second_owner_is_refused_and_told_who_the_first_is(tmp_path: Path) -> None:
    first = OwnerLock("10.0.0.2", 50240, "unwrinkle execute plan.npz", tmp_path)
    second = OwnerLock("10.0.0.2", 50240, "another", tmp_path)
    first.acquire()
    first.acquire()
    with pytest.raises(InUseError, match=r"10\.0\.0\.2:50240") as refusal:
        second.acquire()
    owner = refusal.value.owner
    assert f"process {os.getpid()}" in owner
    assert "unwrinkle execute plan.npz" in owner and "since 20" in owner
    assert pickle.loads(pickle.dumps(refusal.value)).owner == owner
    assert first.held and not second.held
    first.release()
    first.release()
    second.acquire()
    assert second.held
    second.release()


def test_other_robots_are_free(tmp_path: Path) -> None:
    locks = [OwnerLock(host, port, "", tmp_path) for host, port in (("a", 1), ("a", 2), ("b", 1))]
    for lock in locks:
        lock.acquire()
    assert all(lock.held for lock in locks)
    for lock in locks:
        lock.release()


def test_a_process_that_dies_frees_the_lock(tmp_path: Path) -> None:
    script = (
        "import sys; from pathlib import Path; from unwrinkle.hardware.controller.lock import "
        f"OwnerLock; lock = OwnerLock('h', 1, 'child', Path({str(tmp_path)!r})); lock.acquire(); "
        "print('ready', flush=True); sys.stdin.read()"
    )
    child = subprocess.Popen(
        [sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert child.stdout is not None and child.stdin is not None
    assert child.stdout.readline() == "ready\n"
    lock = OwnerLock("h", 1, "", tmp_path)
    with pytest.raises(InUseError, match=rf"process {child.pid} \(child\)"):
        lock.acquire()
    child.kill()
    child.wait(timeout=10)
    child.stdin.close()
    child.stdout.close()
    lock.acquire()
    assert lock.held
    lock.release()


def test_a_lock_file_that_cannot_be_read_or_opened(tmp_path: Path) -> None:
    first, second = (OwnerLock("h", 1, "", tmp_path) for _ in range(2))
    first.acquire()
    first.path.write_text("nonsense")
    with pytest.raises(InUseError, match="left no name"):
        second.acquire()
    with pytest.raises(HardwareError, match="cannot be opened"):
        OwnerLock("h", 1, "", tmp_path / "nowhere").acquire()
    first.release()


def test_the_runtime_directory_is_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert lock_directory() == tmp_path
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "nowhere"))
    assert lock_directory() != tmp_path / "nowhere"
