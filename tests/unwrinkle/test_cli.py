"""Exit codes, messages and start-up of the command line."""

import errno
import logging
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest

from unwrinkle import cli
from unwrinkle.models.errors import InputError, NoVerifiedPlanError


def _main(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr(sys, "argv", ["unwrinkle", *arguments])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    assert isinstance(stop.value.code, int)
    return stop.value.code


def _run(*command: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False)


def _raise_in_bench(monkeypatch: pytest.MonkeyPatch, error: BaseException) -> None:
    def command() -> None:
        raise error

    monkeypatch.setattr("unwrinkle.commands.bench._command", command)


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (InputError("depth.png:\n  truncated"), 2),
        (NoVerifiedPlanError("far hand\n  40 mm short"), 3),
    ],
)
def test_expected_error_is_one_line(
    error: Exception,
    code: int,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    _raise_in_bench(monkeypatch, error)
    assert _main(monkeypatch, "bench", "any") == code
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err == "unwrinkle: " + str(error).replace("\n ", "") + "\n"


def test_keyboard_interrupt_exits_130(monkeypatch: pytest.MonkeyPatch) -> None:
    _raise_in_bench(monkeypatch, KeyboardInterrupt())
    assert _main(monkeypatch, "bench", "any") == 130


def test_unexpected_error_is_not_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    _raise_in_bench(monkeypatch, ZeroDivisionError("a defect"))
    monkeypatch.setattr(sys, "argv", ["unwrinkle", "bench", "any"])
    with pytest.raises(ZeroDivisionError, match="a defect"):
        cli.main()


@pytest.mark.parametrize("arguments", [[], ["fly"], ["bench"], ["bench", "x", "--seed", "-1"]])
def test_usage_error_exits_2(
    arguments: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _main(monkeypatch, *arguments) == 2
    captured = capsys.readouterr()
    assert "Usage: unwrinkle" in captured.out + captured.err


def test_version(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    assert _main(monkeypatch, "--version") == 0
    assert capsys.readouterr().out == f"unwrinkle {metadata.version('unwrinkle')}\n"


@pytest.mark.parametrize(
    ("options", "level"), [([], logging.WARNING), (["-v"], logging.INFO), (["-vv"], logging.DEBUG)]
)
def test_verbose_sets_our_logging_level(
    options: list[str], level: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    _raise_in_bench(monkeypatch, InputError("stop"))
    logger = logging.getLogger("unwrinkle")
    monkeypatch.setattr(logger, "level", logging.CRITICAL)
    assert _main(monkeypatch, *options, "bench", "any") == 2
    assert logger.getEffectiveLevel() == level


def test_every_command_module_is_registered() -> None:
    folder = Path(cli.commands.__file__).parent
    modules = {
        path.stem
        for path in folder.rglob("*.py")
        if not any(part.startswith("_") for part in path.relative_to(folder).parts)
    }
    single = {command.callback.__name__ for command in cli.app.registered_commands}
    assert single | {group.name for group in cli.app.registered_groups} == modules


@pytest.mark.parametrize(("given", "used"), [(None, "1"), ("3", "3")])
def test_linear_algebra_has_one_thread_unless_the_user_says_otherwise(
    given: str | None, used: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    if given is not None:
        monkeypatch.setenv("OPENBLAS_NUM_THREADS", given)
    script = (
        "import atexit, os, sys\n"
        "atexit.register(lambda: print(os.environ['OPENBLAS_NUM_THREADS']))\n"
        "from unwrinkle.cli import main\nsys.argv = ['unwrinkle', '--version']\nmain()"
    )
    assert _run(sys.executable, "-c", script, cwd=tmp_path).stdout.split()[-1] == used


def test_start_up_imports_nothing_heavy(tmp_path: Path) -> None:
    heavy = ["cv2", "matplotlib", "numpy", "pydrake", "ruckig", "scipy", "toppra"]
    script = (
        f"import sys, unwrinkle.cli\nprint([name for name in {heavy!r} if name in sys.modules])"
    )
    result = _run(sys.executable, "-c", script, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert result.stdout.strip() == "[]"


@pytest.mark.end_to_end
def test_installed_command_reports_bad_input(tmp_path: Path) -> None:
    command = Path(sys.executable).with_name("unwrinkle")
    for start in ([command], [sys.executable, "-m", "unwrinkle"]):
        result = _run(*start, "bench", "no-such", cwd=tmp_path)
        assert result.returncode == 2
        assert result.stdout == ""
        assert result.stderr.startswith("unwrinkle: there is no benchmark 'no-such'")
        assert result.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("error", "named"),
    [
        (OSError(errno.ENOSPC, "No space left on device"), "standard output"),
        (ImportError("initialization failed"), "LC_ALL"),
    ],
)
def test_what_no_command_can_help_ends_in_one_line(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    error: Exception,
    named: str,
) -> None:
    def fail(**_: object) -> None:
        raise error

    monkeypatch.setattr(cli, "app", fail)
    monkeypatch.setattr(cli.os, "dup2", lambda *_: None)
    monkeypatch.setattr(cli.sys.stdout, "fileno", lambda: 1, raising=False)
    with pytest.raises(SystemExit) as stop:
        cli.main()
    assert stop.value.code == 2
    shown = capsys.readouterr().err
    assert named in shown
    assert shown.count("\n") == 1


@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "full", "out/a.png"), ImportError("no x")])
def test_other_errors_stay_as_they_are(monkeypatch: pytest.MonkeyPatch, error: Exception) -> None:
    def fail(**_: object) -> None:
        raise error

    monkeypatch.setattr(cli, "app", fail)
    with pytest.raises(type(error)):
        cli.main()
