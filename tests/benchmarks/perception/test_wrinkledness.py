"""The wrinkledness benchmark runs, and its brute force agrees."""

from benchmarks.perception.wrinkledness import run, table


def test_quick_run() -> None:
    results = run(quick=True, seed=1, progress=lambda done, total, stage: None)
    assert results.wrinkledness_time_median > 0.0
    assert max(size.brute_force_difference_max for size in results.sizes) < 1e-4
    assert min(size.bins_used for size in results.sizes) > 20
    assert table(results).count("\n| ") >= 3
