"""Check the kept results: every page is what its report gives, and none is of a quick run.

`python -m benchmarks.harness.check docs/results` (`make bench-check`).
"""

import sys
from pathlib import Path

from benchmarks.harness.registry import MODULES, find, results_type
from benchmarks.harness.report import load_report, page
from unwrinkle.models.errors import InputError


def problems(folder: Path, name: str) -> list[str]:
    """Return what is wrong with a benchmark's kept report and page, a line each."""
    benchmark = find(name)
    path = folder / f"{name}.json"
    try:
        report = load_report(path, results_type(benchmark))
    except InputError as error:
        return [str(error)]
    found = []
    if report.benchmark != name:
        found.append(f"{path}: is a report of {report.benchmark}")
    if report.quick:
        found.append(f"{path}: is of a quick run, which is no result")
    text = path.with_suffix(".md")
    if not text.is_file() or text.read_text(encoding="utf-8") != page(
        report, benchmark.table(report.results)
    ):
        found.append(
            f"{text}: is not the page of its report; write it by "
            f"`python -m benchmarks {name} --from-json {path} --markdown {text}`"
        )
    return found


def main(folder: Path) -> int:
    """Write what is wrong with the results in a folder, and return the exit status."""
    found = [line for name in sorted(MODULES) for line in problems(folder, name)]
    for line in found:
        sys.stdout.write(line + "\n")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
